"""A router: ``router.py ENDPOINT``."""

import sys

from muro_zenoh.config import BusSettings
from muro_zenoh.runtime.process import run_process
from muro_zenoh.transport.router import run_router

if __name__ == "__main__":
    settings = BusSettings(mode="router", connect=(), listen=(sys.argv[1],))
    sys.exit(run_process(lambda: run_router(settings), "router"))
