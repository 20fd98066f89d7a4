"""What a run says in a terminal: a bar for people, a JSON line a scan for programs."""

from __future__ import annotations

import json
import os
import sys
from types import TracebackType
from typing import Any

import typer

from napari_unpack.batches.results import ScanResult


class ScanLines:
    """Tells how far a run is, on stderr; and what came of each scan, on stdout.

    Parameters
    ----------
    as_json : bool
        A JSON line for each scan, and no bar.
    """

    def __init__(self, as_json: bool) -> None:
        self._as_json, self._seen = as_json, 0
        self._bar: Any = None

    def __enter__(self) -> ScanLines:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the bar, and say what an interruption leaves."""
        self._end()
        if kind is KeyboardInterrupt:
            self.say("stopped: what is done is kept, and the same command goes on with the rest")

    def say(self, sentence: str) -> None:
        """Say something to a person."""
        self._end()
        typer.echo(sentence, err=True)

    def told(self, result: ScanResult, done: int, count: int) -> None:
        """Tell what came of a scan.

        Parameters
        ----------
        result : ScanResult
        done, count : int
            How many are done, and how many there are.
        """
        if self._as_json:
            try:
                typer.echo(json.dumps(result.record()))
            except BrokenPipeError:
                # Whoever read them has read enough, as `| head` has: the run goes on.
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return
        if result.status == "failed":
            self.say(f"failed: {result.scan}: {result.reason}")
        self._moved(done, count)

    def _moved(self, done: int, count: int) -> None:
        # A log file gets a line a scan: a bar would fill it with control characters.
        if not sys.stderr.isatty():
            typer.echo(f"{done} of {count} scans", err=True)
            return
        if self._bar is None:
            self._bar = typer.progressbar(length=count, label="scans", file=sys.stderr)
            self._bar.__enter__()
            self._bar.update(self._seen)
        self._bar.update(done - self._seen)
        self._seen = done

    def _end(self) -> None:
        if self._bar is not None:
            self._bar.__exit__(None, None, None)
            self._bar = None
