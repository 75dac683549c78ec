#!/usr/bin/env python3
"""Plays a freshet board from Python, with the standard library alone.

Over the serial port (Linux, macOS), with nothing in between:

    python3 freshet.py /dev/ttyACM0

Over `freshet bridge /dev/ttyACM0` by OSC, on any system:

    python3 freshet.py 127.0.0.1:9000
"""

import os
import select
import socket
import struct
import sys
import time


class Refused(Exception):
    """What the board says it cannot do."""


class Board:
    """A board at a serial port, in lines of text."""

    def __init__(self, port, baud=115200):
        import termios  # Not on Windows: use Osc there.
        import tty

        self.file = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.file)
        settings = termios.tcgetattr(self.file)
        settings[4] = settings[5] = getattr(termios, f"B{baud}")
        termios.tcsetattr(self.file, termios.TCSANOW, settings)
        termios.tcflush(self.file, termios.TCIFLUSH)
        self.rest = b""
        # Ends whatever was half said before.
        os.write(self.file, b"\n")

    def ask(self, line, timeout=5.0):
        """Sends a line; returns the lines of the answer, without the `ok` at their end."""
        while select.select([self.file], [], [], 0)[0] and os.read(self.file, 1024):
            pass  # What nobody asked for.
        self.rest = b""
        os.write(self.file, line.encode() + b"\n")
        answer, until = [], time.monotonic() + timeout
        command = line.split()[0]
        while True:
            said = self.read_line(until)
            if said.startswith("error "):
                raise Refused(said.removeprefix("error "))
            if said == "ok" or said.startswith(f"ok {command}"):
                return answer
            if said:
                answer.append(said)

    def read_line(self, until):
        while b"\n" not in self.rest:
            left = until - time.monotonic()
            if left <= 0 or not select.select([self.file], [], [], left)[0]:
                raise TimeoutError("no answer: is it the board's port?")
            more = os.read(self.file, 1024)
            if not more:
                raise ConnectionError("the board is gone")
            self.rest += more
        line, self.rest = self.rest.split(b"\n", 1)
        return line.decode(errors="replace").strip()

    def set(self, ramp=None, **values):
        """set(water_rate=2000, mix_level=-6): the first `_` of each name is the dot of its path."""
        words = [f"{name.replace('_', '.', 1)}={value}" for name, value in values.items()]
        words += [] if ramp is None else [f"ramp={ramp}"]
        self.ask("set " + " ".join(words))

    def get(self, path):
        return float(self.ask(f"get {path}")[0].split(" = ")[1].split()[0])

    def scene(self, name):
        self.ask(f"scene {name}")

    def trigger(self, *bubble):
        """One bubble: radius in mm, pressure in Pa, rise factor."""
        self.ask(" ".join(["trigger", *map(str, bubble)]))


class Osc:
    """A board behind `freshet bridge`."""

    def __init__(self, host="127.0.0.1", port=9000):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect((host, port))

    def send(self, address, *values):
        """send("/freshet/water/rate", 2000.0)"""
        text = lambda s: s.encode() + b"\0" * (4 - len(s.encode()) % 4)
        tags, data = ",", b""
        for value in values:
            if isinstance(value, str):
                tags, data = tags + "s", data + text(value)
            else:
                tags, data = tags + "f", data + struct.pack(">f", value)
        self.socket.send(text(address) + text(tags) + data)

    def set(self, ramp=None, **values):
        for name, value in values.items():
            address = "/freshet/" + name.replace("_", "/", 1)
            self.send(address, value, *([] if ramp is None else [ramp]))

    def scene(self, name):
        self.send("/freshet/scene", name)

    def trigger(self, *bubble):
        self.send("/freshet/trigger", *bubble)


def main(where):
    host, colon, port = where.rpartition(":")
    board = Osc(host, int(port)) if colon and port.isdigit() else Board(where)
    board.scene("brook")
    for rate in (500, 1000, 2000, 4000):
        board.set(water_rate=rate, ramp=0.3)
        time.sleep(0.4)
    for radius in (6, 5, 4, 3):
        board.trigger(radius, 0.3)
        time.sleep(0.2)
    board.set(water_rate=1500, mix_level=-6, ramp=1)
    if isinstance(board, Board):
        time.sleep(1.1)
        print("water.rate is", board.get("water.rate"))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
