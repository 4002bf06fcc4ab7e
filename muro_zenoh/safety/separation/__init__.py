"""Robots that keep apart: each decides alone, from the snapshots that it received and from its own state.

In a step a robot looks at the twist that its behaviour wants. What is free, passes unchanged. Otherwise *liveness*
and *guidance* propose another one (:mod:`.route`, :mod:`.courtesy`, :mod:`.liveness`, :mod:`.guidance`); they promise
nothing. Nothing is driven that the *certificate* does not accept (:mod:`.certificate`, :mod:`.knowledge`,
:mod:`.line`); when it accepts nothing, the robot brakes.

Why robots that obey the certificate do not touch
-------------------------------------------------

Write ``d`` for the distance of two centres to keep, the sum of the radii and the margin; ``H`` for ``hold``, the time
for which wheels go on with a command at most (the dead-man's, and a period); ``L`` for ``snapshot_limit``.

1. *A common line.* A snapshot gives each pair of robots a line: from where both were and where they come to rest if
   they brake, it is square to the shortest connection of these two stretches. Both compute the same line, because
   both have the same numbers. Robots of which each stays on its side, by its radius and half the margin, are ``d``
   apart.
2. *A command is accepted* when the path under it, held for ``H`` and then braked, is on my side of all lines that I
   obey; and the path when I brake at my next decision, too. So a robot that crashes, freezes or hears nothing any
   more comes to rest on its side of them. A robot whose newest snapshot is older than ``L`` brakes.
3. *Braking keeps the certificate.* A robot that brakes drives the rest of a path that was accepted, and stays on its
   side of the lines that it obeyed then. New lines may cut that path; a braking path may keep such a violation and
   never deepens it. The other robot is safe from it by one of two facts. Either it obeys one of the lines that the
   braking robot obeyed; or its newest snapshot already shows the braking: then the stretch in that snapshot is the
   braking path itself, and the stretch is on its side of that snapshot's line (of two convex sets, each is on its
   side of a line square to their shortest connection, through any point of it).
4. *Two robots with different snapshots* have a line in common. Take j with newest snapshot S, and i. If i was braking
   when S was taken, see 3. Otherwise i accepted a command at most ``H`` before S was taken, with a newest snapshot N
   that was at most ``L`` old. So j obeys every snapshot sent up to ``L + H`` (and the age of the fixes) before S; N
   is one.
5. *Older lines are obeyed only as far as they can matter.* N matters to j only while i goes by N: i drives on at most
   until N is older than ``L``, ``H`` longer if its process dies, and brakes. Where it was when S was taken, j knows.
   What i cannot reach from there by then (speed, acceleration and turning rate within limits, :mod:`.reach`) is no
   side of its any more: j keeps ``d`` from what it can reach, or the line, whichever leaves more room. (i, for which
   N is the newest, obeys N's line as it is.)
6. *Lost snapshots.* Where N itself was lost on the way to j, the snapshots before or after it were not: two
   neighbouring snapshots' lines differ by at most the way in one period, 25 mm at 0.5 m/s, less than the margin. A
   robot that missed all snapshots for 0.3 s listens for ``L + H`` before it drives again, as after its start.
7. *Obstacles.* A robot that is lost, stale, foreign, or disagrees with the cameras does not keep apart: the whole
   ``d`` is kept from where it was seen, and from as far as it may have gone on since, straight on, held and braked.
   It stands still itself: a robot that the cameras do not track where it believes to be brakes.
8. *Silent robots.* One whose estimates do not reach the base station is seen, but nobody knows its speed. It brakes
   when it hears so. Until then it obeys the lines, so the others do as well, and keep ``d`` from where it may be like
   from an obstacle.

Assumed: wheels within their limits and lag; the base zeroes them when a command is older than the dead-man's time;
own state to a few millimetres; the speeds in a snapshot as old as its poses, to 0.1 s; clocks that tell the age of a
snapshot to 0.1 s. The margin (46 mm) pays for what is not exact: drive errors of 20 % before they are known (20 mm at
most, from standstill), curved braking paths taken as straight, slip, lost snapshots. The worst at once may use it up.

Not covered: a wrong pose that is believed; a robot that is carried, or driven by somebody else, into one that stands;
wheels that run away; robots with different settings of the same fleet file; more than a few snapshots lost in a row
by both of two robots in turns.
"""

from muro_zenoh.safety.separation.body import Body, RobotSeen, SharedSnapshot
from muro_zenoh.safety.separation.filter import Separated, Separation
from muro_zenoh.safety.separation.settings import SeparationSettings

__all__ = ["Body", "RobotSeen", "Separated", "Separation", "SeparationSettings", "SharedSnapshot"]
