"""Publishes one robot's speed at 20 Hz with only Zenoh and MessagePack: ``velocities.py ENDPOINT NAME SPEED``."""

import json
import sys
import time

import msgpack
import zenoh

if __name__ == "__main__":
    endpoint, name, speed = sys.argv[1:]
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session:
        print("READY", flush=True)  # noqa: T201 - a line for the test
        while True:
            session.put(f"muro/velocity/{name}", msgpack.packb({"stamp": time.time(), "speed": float(speed)}))
            time.sleep(0.05)
