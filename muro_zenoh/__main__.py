"""The command ``muro`` as ``python -m muro_zenoh``; every process of a run is started this way."""

from muro_zenoh.cli.main import main

main(prog_name="muro")
