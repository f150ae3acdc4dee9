"""Start a broker, the simulated motor and `backsight live` with its dashboard; Ctrl-C ends all."""

import contextlib
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent
PORT = 1883


def broker_is_there() -> bool:
    """Whether something listens where a broker should."""
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", PORT), 1):
        return True
    return False


def main() -> int:
    """Return the exit code."""
    with contextlib.ExitStack() as stack:
        if not broker_is_there():
            program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
            if program is None:
                print("there is no broker: apt install mosquitto", file=sys.stderr)
                return 2
            config = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "broker.conf"
            config.write_text(f"listener {PORT} 127.0.0.1\nallow_anonymous true\n")
            broker = stack.enter_context(subprocess.Popen([program, "-c", str(config)]))
            stack.callback(broker.terminate)
            while not broker_is_there():
                time.sleep(0.05)
        motor = stack.enter_context(subprocess.Popen([sys.executable, str(HERE / "simulate.py")]))
        stack.callback(motor.terminate)
        command = [sys.executable, "-m", "backsight", "live", str(HERE / "live.toml")]
        live = subprocess.Popen(command)
        with contextlib.suppress(KeyboardInterrupt):
            return live.wait()
        return live.wait(20)  # it was interrupted, too, and stores what it has


if __name__ == "__main__":
    sys.exit(main())
