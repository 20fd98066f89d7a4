"""A virtual screen for one process."""

from __future__ import annotations

import os
import subprocess

SIZE = "1600x1000x24"


class Screen:
    """An Xvfb on a free display, which `DISPLAY` names from now on."""

    def __init__(self) -> None:
        number, told = os.pipe()
        command = ["Xvfb", "-displayfd", str(told), "-screen", "0", SIZE, "-nolisten", "tcp"]
        self._server = subprocess.Popen(command, pass_fds=[told], stderr=subprocess.DEVNULL)
        os.close(told)
        with os.fdopen(number) as answer:
            os.environ["DISPLAY"] = f":{answer.readline().strip()}"

    def close(self) -> None:
        """End the server."""
        self._server.terminate()
        self._server.wait()
