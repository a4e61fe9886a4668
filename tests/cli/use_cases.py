"""Use cases that only note how they are called, and give a result or an error."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_tables import PlatformReceiver
from skyproof.app.fleet import FleetResult
from skyproof.app.fleet.rows import FleetRow
from skyproof.app.init import InitResult
from skyproof.app.receive import ReceiveResult
from skyproof.app.scenes.simulate import SimulateResult
from skyproof.app.verify import FileState, Verified
from skyproof.errors import IncompleteOutput
from skyproof.formats.verdict import read_verdict
from skyproof.report.chart import Axes
from skyproof.simulator.scenes import read_ready_made
from skyproof.studies.base import Claim, Study
from skyproof.verdict import Verdict

VERDICT = read_verdict(Path(__file__).parents[1] / "formats" / "verdict-sample.json")
PROTECT = ["protect", "rx1.bin", "rx2.bin", "--out", "result"]
COMMANDS = ("protect", "inspect", "receive", "simulate", "init", "verify", "fleet", "study", "demo")


NO_FILES: dict[str, None] = dict.fromkeys(("nav", "imu", "platform"))
FLEET = (
    FleetRow(name="mast", inputs="mast.obs", state="done", verdict="spoofed", **NO_FILES),
    FleetRow(name="quay", inputs="quay.obs", state="done", verdict="spoofed", **NO_FILES),
    *(FleetRow(name=f"x{n}", inputs="x", state="failed", error="x: absent", **NO_FILES) for n in range(12)),
)


def state_word(word: str) -> Verdict:
    why = {"reason": "one receiver alone", "remedy": "a second receiver"}
    why |= {"not_excluded": ["a false sky from the start"]} if word == "no_attack_seen" else {}
    return Verdict.model_validate(VERDICT.model_dump(mode="json") | {"verdict": word} | why)


class App:
    """Stands for the use cases: notes the calls, gives a result or raises an error."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any, dict[str, Any]]] = []
        self.verdict = VERDICT
        self.interrupted = False
        self.error: BaseException | None = None
        self.missing = ""
        self.rows = FLEET[:2]

    def run(self, name: str, inputs: Any, options: dict[str, Any]) -> Any:
        progress = options.pop("progress")
        with progress.stage(f"doing {name}", 10.0) as stage:
            stage.advance(5.0)
            progress.say("a remark [red]")
        self.calls.append((name, inputs, options))
        if self.error is not None:
            raise self.error
        samples = SimpleNamespace(name="rx1", path="rx1.bin", remarks=())
        reception = SimpleNamespace(
            source=samples,
            n_signals=12,
            noted=("a [dim] remark",),
            observations=None,
            examined_s=4.0,
            left_out="no time",
            messages_differ=(),
            decoded=SimpleNamespace(ephemerides=()),
        )
        if name == "receive":
            received = ReceiveResult(
                signals=((),),
                receptions=(reception,),
                folder=options["out"],
                files=(("rx1-nav.rnx",),),
                interrupted=self.interrupted,
            )
            return self.check_written(received)
        if name == "simulate":
            folder = options["out"]
            recordings, names = tuple(folder / f"rx{k}.bin" for k in range(1, 11)), ("rx1.bin", "truth.json")
            return SimulateResult(
                scenario=read_ready_made("takeover"),
                folder=folder,
                files=names,
                recordings=recordings,
                observations=(folder / "rx1.obs",),
                interrupted=self.interrupted,
            )
        folder = options.get("out", inputs)
        return self.check_written(SimpleNamespace(verdict=self.verdict, folder=folder, interrupted=self.interrupted))

    def check_written(self, result: Any) -> Any:
        """Return the result, unless files are missing."""
        if self.missing:
            raise IncompleteOutput(self.missing, result)
        return result

    def init(self, files: list[Path], **options: Any) -> InitResult:
        self.calls.append(("init", files, options))
        return InitResult(path=options["out"], platform=Platform(receivers=(PlatformReceiver(name="bow"),)))

    def verify(self, folder: Path, **options: Any) -> Verified:
        del options["progress"]
        self.calls.append(("verify", folder, options))
        return Verified(verdict=self.verdict, files=(FileState(name="report.html", kind="output", state="same"),))

    def fleet(self, catalogue: Path, **options: Any) -> FleetResult:
        del options["progress"]
        self.calls.append(("fleet", catalogue, options))
        return FleetResult(rows=self.rows, folder=options["out"], interrupted=self.interrupted)

    def inspect(self, file: Path, **options: Any) -> list[Any]:
        self.calls.append(("inspect", file, options))
        return []

    def make_studies(self) -> dict[str, Study]:
        """Make two studies that note the call and give two rows, the first of them before an error."""

        def run(settings: Any) -> Iterator[dict[str, Any]]:
            self.calls.append(("study", settings.trials, {"seed": settings.seed, "quick": settings.quick}))
            yield {"method": "paper", "window_s": 10, "kept": np.float64(0.5)}
            if self.error is not None:
                raise self.error
            yield {"method": "skyproof", "window_s": 30, "kept": float("nan")}

        words: dict[str, Any] = {"paper": "Someone 2022", "figure": "Figure 1", "title": "What is kept", "run": run}
        chart = Axes(title="kept", x="window_s", y="kept", x_label="window, s", y_label="kept", by=("method",))
        claim = Claim(what="kept at 10 s", paper=0.5, same=lambda rows: rows[0]["kept"], tolerance=0.1)
        drawn = Study(name="multi-receiver.false-alarm", charts=(chart,), claims=(claim,), **words)
        return {drawn.name: drawn, "spin.roc": Study(name="spin.roc", **words)}
