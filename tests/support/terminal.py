"""A terminal of a given size: a program runs on a real pty, and what stands on the screen can be read."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time

_SEQUENCE = re.compile(rb"\x1b\[([?0-9;]*)([A-Za-z])|\x1b[()][0-9A-B]|\x1b[=>78]")


class Screen:
    """What a program's output leaves on a screen of `columns` x `rows`.

    wrapped: rows that were too long and went on in the next. scrolled: lines that moved out at the top while the
    alternate screen was shown.
    """

    def __init__(self, columns, rows):
        self.columns, self.rows = columns, rows
        self.wrapped = self.scrolled = 0
        self.alternate = False
        self._rest = b""
        self._clear()

    def _clear(self):
        self.cells = [[" "] * self.columns for _ in range(self.rows)]
        self.x = self.y = 0

    @property
    def lines(self):
        return ["".join(row).rstrip() for row in self.cells]

    @property
    def text(self):
        return "\n".join(self.lines)

    def feed(self, data):
        data, at = self._rest + data, 0
        self._rest = b""
        while at < len(data):
            if data[at] == 0x1B:
                match = _SEQUENCE.match(data, at)
                if match is None:
                    self._rest = data[at:]
                    return
                self._command(match)
                at = match.end()
                continue
            end = next((k for k in range(at, len(data)) if data[k] in b"\x1b\r\n"), len(data))
            if end > at:
                try:
                    text = data[at:end].decode()
                except UnicodeDecodeError:
                    if end < len(data):
                        raise
                    self._rest = data[at:]
                    return
                for letter in text:
                    self._put(letter)
                at = end
                continue
            if data[at : at + 1] == b"\r":
                self.x = 0
            else:
                self._down()
            at += 1

    def _put(self, letter):
        if self.x >= self.columns:
            self.wrapped += 1
            self.x = 0
            self._down()
        self.cells[self.y][self.x] = letter
        self.x += 1

    def _down(self):
        if self.y + 1 < self.rows:
            self.y += 1
            return
        self.scrolled += self.alternate
        self.cells = [*self.cells[1:], [" "] * self.columns]

    def _command(self, match):
        if match.group(2) is None:
            return
        words, command = match.group(1).decode(), match.group(2).decode()
        numbers = [int(word) if word.isdigit() else 0 for word in words.split(";")]
        if words == "?1049" and command in "hl":
            self.alternate = command == "h"
            self._clear()
        elif command == "H":
            self.y = min(max(numbers[0], 1), self.rows) - 1
            self.x = min(max(numbers[1] if len(numbers) > 1 else 1, 1), self.columns) - 1
        elif command == "A":
            self.y = max(self.y - max(numbers[0], 1), 0)
        elif command == "J":
            self.cells = [[" "] * self.columns for _ in range(self.rows)]
        elif command == "K":
            self.cells[self.y][self.x if numbers[0] == 0 else 0 :] = [" "] * (
                self.columns - (self.x if numbers[0] == 0 else 0)
            )
        else:
            assert command in "mhl", match.group()


class OnTerminal:
    """A program on a pty of `columns` x `rows`; use it in a `with`."""

    def __init__(self, words, *, cwd, environment, columns=80, rows=24):
        self.screen = Screen(columns, rows)
        self.said = ""
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        plain = ("COLUMNS", "LINES", "NO_COLOR")
        environment = {name: value for name, value in environment.items() if name not in plain}
        self.process = subprocess.Popen(
            list(map(str, words)), cwd=cwd, env=environment | {"TERM": "xterm-256color", "COLORTERM": "truecolor"},
            stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
        )  # fmt: skip
        os.close(slave)

    def until(self, condition, seconds=60.0):
        """Read what the program shows until `condition(screen)` holds."""
        end = time.monotonic() + seconds
        while not condition(self.screen):
            assert time.monotonic() < end, self.screen.text
            assert self._read(0.1), self.screen.text
        while select.select([self._master], [], [], 0.03)[0] and self._read(
            0
        ):  # the rest of the same picture
            pass
        return self.screen

    def wait_for(self, words, seconds=120.0):
        """Read until the program has written `words` since the last call; `said` is what it wrote behind them."""
        end = time.monotonic() + seconds
        while words not in self.said:
            assert time.monotonic() < end, self.said[-2000:]
            assert self._read(0.1), self.said[-2000:]
        self.said = self.said.partition(words)[2]

    def press(self, keys):
        os.write(self._master, keys.encode())

    def close(self):
        """Close the window, and leave the program alone."""
        os.close(self._master)
        self._master = -1

    def ended(self, seconds=60.0):
        """Read until the program ends; gives its exit status."""
        end = time.monotonic() + seconds
        while self._read(0.1):
            assert time.monotonic() < end, self.screen.text
        return self.process.wait(10)

    def _read(self, wait):
        if not select.select([self._master], [], [], wait)[0]:
            return self.process.poll() is None
        try:
            data = os.read(self._master, 1 << 16)
        except OSError:  # the program has closed its end
            return False
        self.screen.feed(data)
        self.said += data.decode(errors="replace")
        return bool(data)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(10)
        if self._master >= 0:
            os.close(self._master)
