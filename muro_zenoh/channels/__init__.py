"""The topology: which role writes and reads what, on which key, how often. ``docs/channels.md`` is made from it.

``table`` has the rows, ``kinds`` what a row is, ``keys`` the names and keys, ``page`` the documentation. Its names are
those of the first three: a list of them here would be a second table.
"""

from muro_zenoh.channels.keys import *
from muro_zenoh.channels.kinds import *
from muro_zenoh.channels.table import *
