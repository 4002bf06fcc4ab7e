/**
 * What goes over the WebSocket, as types: MessagePack maps, both ways. docs/page.md explains them.
 *
 * SI units, radians in (-pi, pi], a right-handed world frame: x right, y up, theta counter-clockwise from x.
 *
 * @typedef {[number, number]} Point  x, y [m, world].
 * @typedef {[number, number, number, number]} Box  x_min, y_min, x_max, y_max [m, world].
 * @typedef {[number, number, number, number]} Wall  from x, y to x, y [m, world].
 *
 * @typedef {object} RobotFacts  A robot of the fleet file.
 * @property {number} radius  of its body [m].
 * @property {number} v_max  [m/s].
 * @property {number} omega_max  [rad/s].
 * @property {number} margin  free floor that the separation filter keeps between two bodies [m].
 *
 * @typedef {object} Parameter  A parameter of a behaviour or a fault, with its limits.
 * @property {"number" | "integer" | "boolean" | "text" | "array" | "choice"} type
 * @property {any} default
 * @property {boolean} [required]  there is no default.
 * @property {string} [unit]
 * @property {number | null} [at_least]
 * @property {number | null} [above]
 * @property {number | null} [at_most]
 * @property {number | null} [below]
 * @property {string} [doc]
 * @property {string[] | null} [choices]
 * @property {[string, string[]] | null} [when]  it is there only while the choice of this key is one of these.
 *
 * @typedef {object} BehaviourFacts
 * @property {string} summary  what it does, in one line.
 * @property {string[]} needs  its inputs; "goal" among them when it drives to goals, "drive" when a hand drives it.
 * @property {Record<string, Parameter>} parameters
 *
 * @typedef {object} FaultFacts
 * @property {string} doc  what it does, in one line.
 * @property {string[]} targets  what it can befall.
 * @property {Record<string, Parameter>} parameters
 *
 * @typedef {object} Hello  Said first, and again when it changes.
 * @property {"hello"} kind
 * @property {string} realm
 * @property {string} [scenario]
 * @property {Box} arena
 * @property {Wall[]} walls  those inside the arena.
 * @property {Record<string, RobotFacts>} robots  every robot of the fleet file.
 * @property {Record<string, BehaviourFacts>} behaviours
 * @property {Record<string, {outline: Point[]}>} cameras  the floor that each sees.
 * @property {boolean} may_steer  whether this page's token is an operator's.
 * @property {boolean} simulated  whether things may be broken.
 * @property {Record<string, FaultFacts>} [faults]  how.
 *
 * @typedef {object} PlannedPath
 * @property {number} x  where it begins [m].
 * @property {number} y
 * @property {number} theta  in which direction [rad].
 * @property {[number, number][]} segments  length [m] and curvature [1/m] of each, positive to the left.
 *
 * @typedef {"driving" | "holding" | "stopped" | "failed" | "stale" | "lost" | "unseen" | "absent"} Condition
 *
 * @typedef {[
 *   x: number | null, y: number | null, theta: number | null, v: number | null, omega: number | null,
 *   age: number | null, cmd_v: number | null, cmd_omega: number | null
 * ]} Row  Where a robot is, what it does, the age of its place, and the newest command to its wheels.
 *
 * @typedef {object} Details  What is known of a robot besides.
 * @property {Condition} state
 * @property {string} reason  why it does not drive; empty for one that does.
 * @property {string} note  what the separation filter does.
 * @property {string[]} complaints  what else its agent complains of.
 * @property {number | null} pose_age  median of the last second [s].
 * @property {number | null} latency  from pose to command, median of the last second [s].
 * @property {[number | null, number | null]} cal  cal0, calD.
 * @property {string} wheels  what its base complains of; empty for nothing.
 * @property {string | null} behaviour
 * @property {Record<string, any>} parameters
 * @property {PlannedPath | null} path
 * @property {{corners: Point[], x: number, y: number} | null} cell
 * @property {[number, number, number | null] | null} goal
 *
 * @typedef {object} Circle
 * @property {number} x
 * @property {number} y
 * @property {number} radius
 * @property {boolean} clockwise
 * @property {number} revision
 * @property {number[] | null} [importance]  at 64 angles, 2 pi k / 64; mean 1.
 *
 * @typedef {object} ProcessReport
 * @property {string} role
 * @property {boolean} alive
 * @property {string | null} [state]
 * @property {number | null} [age]  of its last report [s].
 * @property {string[]} [reasons]
 * @property {string[]} [complaints]
 * @property {number | null} [cpu]  [% of a core].
 * @property {number | null} [memory]  [MB].
 * @property {Record<string, number>} [rates]  of what it receives [Hz].
 * @property {Record<string, number>} [ages]  of the newest of it [s].
 * @property {number | null} [drops]
 * @property {number | null} [rejects]
 *
 * @typedef {[number: number, t: number, process: string, text: string]} Event
 *
 * @typedef {object} State  Each tick; what is missing has not changed.
 * @property {"state"} kind
 * @property {number} t
 * @property {number} seq
 * @property {Record<string, Row>} robots
 * @property {Record<string, Details>} [details]
 * @property {Circle | null} [circle]
 * @property {Record<string, number>} [gaps]  angle from a robot to the next in the direction of travel [rad].
 * @property {{all: boolean, names: string[], revision: number}} [stop]
 * @property {{program: string, operator: string, names: string[], since: number}[]} [lease]
 * @property {Record<string, ProcessReport>} [processes]
 * @property {Event[]} [events]  new ones.
 * @property {{rows: string, lasting: string[]}} [faults]  what was broken in this run, as rows of its scenario; what
 *   still is, in words.
 *
 * @typedef {object} Receipt  What a stop came to.
 * @property {boolean} confirmed
 * @property {Record<string, {status: string, latched_after_s: number | null, at_rest_after_s: number | null,
 *   travelled_m: number | null, silent_s: number | null}>} robots
 *
 * @typedef {object} Reply
 * @property {"reply"} kind
 * @property {number} id
 * @property {string} [order]
 * @property {"taken" | "refused" | "unanswered"} outcome
 * @property {string} [reason]
 * @property {Receipt | null} [receipt]
 *
 * @typedef {object} Picture  The floor from above, as a camera sees it.
 * @property {"picture"} kind
 * @property {string} camera
 * @property {number} t
 * @property {Uint8Array<ArrayBuffer>} jpeg
 * @property {Box} area
 *
 * @typedef {Hello | State | Reply | Picture} Message
 */

export {};
