"""A motor that drives a mill, in real time: publishes current and speed by MQTT.

Its bearing wears: after a minute the friction begins to rise. Batches are swapped now and then, and
one in twenty comes half a second late, as on a network.
"""

import argparse
import contextlib
import json
import math
import random
import time
from collections.abc import Iterator

KT, J, FRICTION = 0.11, 2.4e-3, 1.5e-3
DT, BATCH = 1e-3, 20
WEAR_BEGINS, WEAR = 60.0, 4e-5  # s, Nm s/rad per second
SIGMA = 0.05  # rad/s


def batches(begin: float, seed: int = 0) -> Iterator[dict[str, list[float]]]:
    """Batches of samples, the first one at the time `begin`, without end."""
    chance = random.Random(seed)
    speed, k = 0.0, 0
    while True:
        batch: dict[str, list[float]] = {"t": [], "current": [], "speed": []}
        for _ in range(BATCH):
            t = k * DT
            current = 3.0 + (1.5 if chance.random() < 0.5 and k % 50 == 0 else 0.0)
            current += 1.5 * math.sin(2.0 * t) + math.sin(7.3 * t)
            batch["t"].append(begin + t)
            batch["current"].append(current)
            batch["speed"].append(speed + SIGMA * chance.gauss(0.0, 1.0))
            friction = FRICTION + WEAR * max(0.0, t - WEAR_BEGINS)
            load = 0.1 if int(t / 7.0) % 2 else 0.05  # Nm: the mill is fed in lumps
            for _ in range(4):  # small steps of the truth
                speed += DT / 4 * (KT * current - friction * speed - load) / J
            k += 1
        yield batch


def main() -> None:
    """Publish until it is interrupted."""
    import paho.mqtt.client as mqtt

    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--port", type=int, default=1883)
    port = given.parse_args().port
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", port)
    client.loop_start()
    begin, chance = time.time(), random.Random(1)
    waiting: list[tuple[float, str]] = []
    for number, batch in enumerate(batches(begin)):
        due = begin + (number + 1) * BATCH * DT
        late = 0.5 if chance.random() < 0.05 else 0.0
        waiting.append((due + late, json.dumps(batch)))
        time.sleep(max(due - time.time(), 0.0))
        for moment, payload in list(waiting):
            if moment <= time.time():
                client.publish("mill/motor", payload, qos=1)
                waiting.remove((moment, payload))


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
