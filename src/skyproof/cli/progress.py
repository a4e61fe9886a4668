"""How far the work is: bars with the time left for a person at a terminal, one line a stage for a log."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import timedelta
from typing import IO, Any, cast

from rich import progress as rich_progress
from rich.console import Console
from rich.table import Column
from rich.text import Text

from skyproof.app.common.progress import Progress, Stage
from skyproof.cli.screen import complain

__all__ = ["progress"]

BAR_WIDTH, BESIDE_WIDTH = 24, 24
"""Of a bar, and of the share and the time beside it; the rest of the line is for the name of the stage."""


def progress() -> Progress:
    """Choose bars only where standard error is a terminal: a log shall hold none."""
    return _Bars(Console(file=cast(IO[str], _Bearing(sys.stderr)))) if sys.stderr.isatty() else _Lines()


class _Bearing:
    """A stream that bears not being written: a terminal that is closed does not end the work."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            self._stream.flush()


class _Lines:
    """Progress as one line a stage."""

    def advance(self, to: float) -> None:
        pass

    def say(self, text: str) -> None:
        complain(text)

    @contextmanager
    def stage(self, name: str, total: float | None) -> Iterator[Stage]:
        self.say(name)
        yield self


class _Bar:
    def __init__(self, bars: rich_progress.Progress, task: rich_progress.TaskID) -> None:
        self._bars, self._task = bars, task

    def advance(self, to: float) -> None:
        self._bars.update(self._task, completed=to)


class _Time(rich_progress.ProgressColumn):
    """The time left once it can be estimated; until then, and where the amount of work is not known, the time taken."""

    max_refresh = 0.5

    def render(self, task: rich_progress.Task) -> Text:
        left_s = task.time_remaining
        if task.total is None or left_s is None:
            done = f"{task.completed:g} so far, " if task.total is None and task.completed else ""
            return Text(f"{done}{timedelta(seconds=int(task.elapsed or 0.0))}", style="progress.elapsed")
        return Text(f"{timedelta(seconds=int(left_s))} left", style="progress.remaining")


class _Bars:
    """Progress as bars with the time left, gone when the work is done."""

    def __init__(self, console: Console) -> None:
        self._bars = rich_progress.Progress(
            rich_progress.TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True)),
            rich_progress.BarColumn(bar_width=BAR_WIDTH),
            rich_progress.TaskProgressColumn(),
            _Time(Column(no_wrap=True)),
            console=console,
            transient=True,
        )

    def say(self, text: str) -> None:
        self._bars.console.print(Text(f"skyproof: {text}"), soft_wrap=True)

    @contextmanager
    def stage(self, name: str, total: float | None) -> Iterator[Stage]:
        if not self._bars.tasks:
            self._bars.start()
        room = max(self._bars.console.width - BAR_WIDTH - BESIDE_WIDTH, 1)
        task = self._bars.add_task(name if len(name) <= room else f"{name[: room - 1]}…", total=total)
        try:
            yield _Bar(self._bars, task)
        finally:
            self._bars.remove_task(task)
            if not self._bars.tasks:
                self._bars.stop()
