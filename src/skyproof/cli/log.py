"""What `skyproof inspect` shows of a log or an observation file."""

from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.padding import Padding

from skyproof.cli.screen import print_table, table, words

if TYPE_CHECKING:
    from skyproof.app.inspect import LogInspection

__all__ = ["show_log"]

_MESSAGES: Final = 16
_NOTES: Final = 6


def show_log(console: Console, log: "LogInspection") -> None:
    """Show a log on one screen: signals, messages with their rates, what is damaged, what would help."""
    console.print(words(log.path, style="bold"), soft_wrap=True)
    console.print(words(log.summary))
    console.print()
    if log.signals:
        rows = table("system", "band", "code", "satellites", "most at once", "C/N0 dB-Hz", numbers=3)
        for s in log.signals:
            level = f"{s.cn0_dbhz:.1f}" if s.cn0_dbhz == s.cn0_dbhz else ""
            rows.add_row(s.system, s.band, s.code, str(s.satellites), str(s.most_at_once), level)
        print_table(console, rows)
        console.print()
    if log.messages:
        rows = table("message", "count", "a second", numbers=2)
        for name, count in list(log.messages.items())[:_MESSAGES]:
            rate = f"{count / log.duration_s:.3g}" if log.duration_s > 0.0 else ""
            rows.add_row(name, str(count), rate)
        print_table(console, rows)
        if len(log.messages) > _MESSAGES:
            console.print(words(f"and {len(log.messages) - _MESSAGES} more kinds: --json has all", style="dim"))
        console.print()
    receiver_data = [("positions", log.fixes), ("levels of the front end", log.levels), ("states", log.states)]
    held = ", ".join(f"{count} {name}" for name, count in receiver_data if count)
    if held:
        alarms = f"; it alarms in {log.alarms}" if log.alarms else ""
        console.print(words(f"The receiver's own: {held}{alarms}."))
    notes = [
        *([f"{log.damaged_frames} frames fail their checksum"] if log.damaged_frames else []),
        *(["the log ends inside a frame"] if log.cut else []),
        *([f"{log.gaps} gaps in its epochs"] if log.gaps else []),
        *log.remarks,
    ]
    for note in notes[:_NOTES]:
        console.print(Padding(words(f"· {note}", style="yellow"), (0, 0, 0, 2)))
    if len(notes) > _NOTES:
        console.print(words(f"  · and {len(notes) - _NOTES} more: --json has all", style="yellow"))
    console.print(words(log.advice, style="bold"))
    for line in log.configuration:
        console.print(words(f"To turn them on: {line}", style="green"), soft_wrap=True)
