"""``python -m muro_zenoh.channels docs/channels.md``: regenerate the tables in the page."""

import sys
from pathlib import Path

from muro_zenoh.channels.page import page

for name in sys.argv[1:]:
    path = Path(name)
    path.write_text(page(path.read_text(encoding="utf-8")), encoding="utf-8")
