"""How far the work is: bars for a person at a terminal, lines for a log."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich import progress as rich_progress
from rich.console import Console
from rich.text import Text

from skyproof.app.progress import Progress, Stage
from skyproof.cli.screen import complain

__all__ = ["progress"]


def progress() -> Progress:
    """Bars for a person at a terminal, lines for a log."""
    console = Console(stderr=True)
    return _Bars(console) if console.is_terminal else _Lines()


class _Lines:
    """Progress as one line a stage."""

    def advance(self, to: float) -> None:
        pass

    def say(self, text: str) -> None:
        complain(text)

    @contextmanager
    def stage(self, name: str, total: float) -> Iterator[Stage]:
        self.say(name)
        yield self


class _Bar:
    def __init__(self, bars: rich_progress.Progress, task: rich_progress.TaskID) -> None:
        self._bars, self._task = bars, task

    def advance(self, to: float) -> None:
        self._bars.update(self._task, completed=to)


class _Bars:
    """Progress as bars with the time left, gone when the work is done."""

    def __init__(self, console: Console) -> None:
        self._bars = rich_progress.Progress(
            rich_progress.TextColumn("{task.description}", markup=False),
            rich_progress.BarColumn(),
            rich_progress.TaskProgressColumn(),
            rich_progress.TimeRemainingColumn(),
            console=console,
            transient=True,
        )

    def say(self, text: str) -> None:
        self._bars.console.print(Text(f"skyproof: {text}"), soft_wrap=True)

    @contextmanager
    def stage(self, name: str, total: float) -> Iterator[Stage]:
        if not self._bars.tasks:
            self._bars.start()
        task = self._bars.add_task(name, total=total)
        try:
            yield _Bar(self._bars, task)
        finally:
            self._bars.remove_task(task)
            if not self._bars.tasks:
                self._bars.stop()
