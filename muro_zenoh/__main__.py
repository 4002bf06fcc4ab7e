"""The command ``muro`` as ``python -m muro_zenoh``; so every process of a run is started."""

from muro_zenoh.cli.main import main

main(prog_name="muro")
