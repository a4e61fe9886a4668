"""What is held of place and time while overlapping signals draw a receiver off: ready-made scenes through `protect`.

    python bench/held.py texbat-like-3 texbat-like-7         rows of these scenes, whole, behind drawn correlators
    python bench/held.py --short texbat-like-3               shorter, of 5 Msps
    python bench/held.py --samples --folder held las-vegas   short and through samples, which are kept and used again

Drawn correlators (`skyproof.studies.correlator_model`) take some seconds a scene, samples hours. Short scenes are of 5
Msps, but for `static-austin`, which is as it is: onset and pull come sooner, the pull's speed and the powers stay. What
the user states: that the receiver stands, its inertial unit with the attitude at the start, the oscillator's class; and
the navigation file of the day. The word comes at the end of the first window in which a test says spoofed or attack;
errors are in space. An attack that is there from the first sample counts from its pull on.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import tomli_w

from skyproof.app.protect import protect
from skyproof.app.protect.coasting import usable_fixes
from skyproof.app.protect.outcome import Outcome
from skyproof.app.scenes.simulate import load_scenario
from skyproof.arrays import Reals
from skyproof.detectors.prediction.choice_findings import CHOSEN
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import heading_pitch_roll_rad
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import seconds_between
from skyproof.records import Fix, FixStatus
from skyproof.simulator.files import write_samples, write_series
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd, SceneImu
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene
from skyproof.verdict import Verdict

FIVE_MSPS: Final = FrontEnd(rate_hz=5e6, bandwidth_hz=4e6, encoding="sign-magnitude", bits=2)
STANDS: Final = {"motion": "static", "oscillator": "ocxo"}
DRIVES: Final = {"motion": "moving", "oscillator": "ocxo"}
FLIES: Final = {"motion": "moving"}
_LATE: Final = ((58.0, 0.0), (178.0, 600.0 / SPEED_OF_LIGHT_M_S))
_UP: Final = ((58.0, 0.0, 0.0, 0.0), (178.0, 0.0, 0.0, 600.0))
_SEAMLESS: Final = {
    "onset_s": 40.0,
    "seamless_s": (40.0, 60.0),
    "amplitude_points": ((65.0, 1.0), (315.0, 0.5)),
    "clock_points_s": ((65.0, 0.0), (383.0, 381.6 / SPEED_OF_LIGHT_M_S)),
}


@dataclass(frozen=True, kw_only=True)
class Held:
    """How a ready-made scene is made shorter, and what is stated. attack : fields of its takeover.

    sigma_deg : of the attitude at the start.
    """

    duration_s: float
    stated: Mapping[str, Any]
    attack: Mapping[str, Any] = field(default_factory=dict)
    front_end: FrontEnd | None = FIVE_MSPS
    sky_until_s: float | None = None
    sigma_deg: float | None = None


SCENES: Final[dict[str, Held]] = {
    "texbat-like-1": Held(duration_s=80.0, stated=STANDS, attack={"onset_s": 55.0}, sky_until_s=55.0),
    "texbat-like-2": Held(
        duration_s=110.0,
        stated=STANDS,
        attack={"onset_s": 40.1, "clock_points_s": _LATE},
    ),
    "texbat-like-3": Held(
        duration_s=150.0,
        stated=STANDS,
        attack={"onset_s": 48.9, "clock_points_s": ((84.0, 0.0), (204.0, 600.0 / SPEED_OF_LIGHT_M_S))},
    ),
    "texbat-like-4": Held(
        duration_s=110.0,
        stated=STANDS,
        attack={"onset_s": 43.8, "away_points_enu_m": _UP},
    ),
    "texbat-like-5": Held(
        duration_s=110.0,
        stated=DRIVES,
        attack={"onset_s": 32.0, "clock_points_s": _LATE},
    ),
    "texbat-like-6": Held(
        duration_s=110.0,
        stated=DRIVES,
        attack={"onset_s": 35.0, "away_points_enu_m": _UP},
    ),
    "texbat-like-7": Held(duration_s=140.0, stated=STANDS, attack=_SEAMLESS),
    "texbat-like-8": Held(duration_s=140.0, stated=STANDS, attack=_SEAMLESS),
    "static-austin": Held(duration_s=130.0, stated=STANDS, front_end=None),
    "las-vegas": Held(
        duration_s=115.0,
        stated=FLIES,
        attack={"away_points_enu_m": ((35.0, 0.0, 0.0, 0.0), (95.0, 127.279, 0.0, 127.279))},  # 3 m/s
        sigma_deg=0.1,
    ),
}


def scene_named(name: str, grade: str = "navigation", *, short: bool = False) -> Scene:
    """The scene, worked out. grade : of the inertial unit, where it has one."""
    held, scenario = SCENES[name], load_scenario(name)
    (receiver,), (attack,) = scenario.receivers, scenario.attacks
    changes: dict[str, Any] = {}
    if short:
        changes |= {
            "duration_s": held.duration_s,
            "attacks": (attack.model_copy(update=dict(held.attack)),),
            "sky": scenario.sky.model_copy(update={"until_s": held.sky_until_s}),
            "front_end": held.front_end or scenario.front_end,
        }
    if receiver.imu is not None:
        changes["receivers"] = (receiver.model_copy(update={"imu": SceneImu(grade=grade, rate_hz=100.0)}),)
    scenario = scenario.model_copy(update=changes)
    return make_scene(scenario, make_nominal_constellation(scenario.start_gpst))


def row_of(scene: Scene, name: str, folder: Path, grade: str, *, samples: bool) -> dict[str, Any]:
    """A scene's row; samples are rendered into the folder if they are not there."""
    held, (receiver,) = SCENES[name], scene.scenario.receivers
    stated = dict(held.stated) | {"receivers": [{"name": receiver.name}]}
    if receiver.imu is not None:
        write_series(scene, folder)
        stated["imu"] = {"file": f"{receiver.name}-imu.csv", "grade": grade, "initial": _attitude(scene, held)}
    platform = folder / "platform.toml"
    platform.write_text(tomli_w.dumps(stated), encoding="utf-8")
    verdict, outcome = (_by_samples if samples else _by_correlators)(scene, folder, platform)
    return {"scene": name, "verdict": verdict.verdict} | _words(scene, outcome) | _fixes(scene, outcome)


def _by_samples(scene: Scene, folder: Path, platform: Path) -> tuple[Verdict, Outcome]:
    recording, nav = folder / f"{scene.skies[0].name}.bin", folder / "broadcast.rnx"
    if not recording.exists():
        write_samples(scene, folder, "raw")
    write_nav(nav, scene.navigation)
    result = protect([recording], nav=nav, platform=platform)
    return result.verdict, result.outcome


def _by_correlators(scene: Scene, folder: Path, platform: Path) -> tuple[Verdict, Outcome]:
    return protect_scene(scene, scene.navigation, platform, scene.scenario.seed)


def _attitude(scene: Scene, held: Held) -> dict[str, float]:
    (name,) = (receiver.name for receiver in scene.scenario.receivers)
    at = scene.trajectories[name].at(np.zeros(1))
    heading, pitch, roll = np.degrees(heading_pitch_roll_rad(at.position_ecef_m[0], at.attitude[0]))
    return {
        "heading_deg": float(heading),
        "pitch_deg": float(pitch),
        "roll_deg": float(roll),
        "sigma_deg": float(held.sigma_deg or 1.0),
    }


def _begins_s(scene: Scene) -> tuple[float, float | None]:
    """Onset and pull of the attack, None if nothing is drawn off. One that was there before begins with its pull."""
    (attack,) = scene.scenario.attacks
    points = [*attack.away_points_enu_m[:1], *attack.clock_points_s[:1]]  # type: ignore[union-attr]
    pull_s = min((point[0] for point in points), default=None)
    return (attack.onset_s if attack.onset_s > 0.0 or pull_s is None else pull_s), pull_s


def _words(scene: Scene, outcome: Outcome) -> dict[str, Any]:
    start, (onset_s, pull_s) = scene.scenario.start_gpst, _begins_s(scene)
    saying = [e for e in outcome.evidence if e.says in ("spoofed", "attack")]
    ends_s = sorted(float(seconds_between(e.end_gpst, start)) for e in saying)
    later = [s for s in ends_s if s > onset_s]
    return {
        "alarms_before": len(ends_s) - len(later),
        "after_onset_s": later[0] - onset_s if later else None,
        "after_pull_s": later[0] - pull_s if later and pull_s is not None else None,
        "by": sorted({e.detector for e in saying}),
        "chosen": any(e.detector == "prediction" and e.code in CHOSEN for e in outcome.evidence),
    }


def _fixes(scene: Scene, outcome: Outcome) -> dict[str, Any]:
    """Errors of place and time, m: 95 % and worst of the trusted ones, worst of an ordinary receiver's."""
    (r,) = outcome.receivers
    if r.positions is None:
        return {"trusted": 0}
    trusted = [_errors_m(scene, fix) for kind, fix in usable_fixes(r.positions) if kind != "consistent"]
    whole = r.positions.whole("unprotected")
    ordinary = np.empty((0, 3)) if whole is None else _errors_m(scene, whole)
    rows = np.concatenate(trusted) if trusted else np.empty((0, 3))
    onset_s, _ = _begins_s(scene)
    clock_m = _parted(rows, onset_s)
    return {
        "trusted": len(rows),
        "trusted_95_m": float(np.quantile(rows[:, 1], 0.95)) if len(rows) else None,
        "trusted_worst_m": float(rows[:, 1].max()) if len(rows) else None,
        "trusted_clock_m": float(np.abs(clock_m).max()) if clock_m.size else None,
        "ordinary_worst_m": float(ordinary[:, 1].max()) if len(ordinary) else None,
        "ordinary_clock_m": float(np.abs(_parted(ordinary, onset_s)).max()) if len(ordinary) else None,
    }


def _errors_m(scene: Scene, fix: Fix) -> Reals:
    """Of each fix (n, 3): its time in s, error of place, c times the clock less the true one."""
    good = np.flatnonzero(fix.status == FixStatus.OK)
    at_s = np.asarray(seconds_between(fix.gpst[good], scene.scenario.start_gpst), np.float64)
    sky = scene.skies[0]
    place_m = np.linalg.norm(fix.position_ecef_m[good] - sky.point(at_s).position_ecef_m, axis=1)
    return np.stack((at_s, place_m, SPEED_OF_LIGHT_M_S * fix.clock_bias_s[good]), axis=1)


def _parted(rows: Reals, onset_s: float) -> Reals:
    """The clock's departure from the straight line that it was on before the onset."""
    early = rows[rows[:, 0] < onset_s]
    if len(early) < 10:
        return np.empty(0)
    return np.asarray(rows[:, 2] - np.polyval(np.polyfit(early[:, 0], early[:, 2], 1), rows[:, 0]))


def main() -> None:
    """Print a row for each scene that is named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", choices=SCENES)
    parser.add_argument("--grade", default="navigation", help="of the inertial unit")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--samples", action="store_true", help="short ones, through samples")
    parser.add_argument("--folder", type=Path, help="where samples are kept")
    asked = parser.parse_args()
    for name in asked.scenes:
        with TemporaryDirectory(prefix="held") as made:
            folder = Path(made) if asked.folder is None else asked.folder / name
            folder.mkdir(parents=True, exist_ok=True)
            scene = scene_named(name, asked.grade, short=asked.short or asked.samples)
            row = row_of(scene, name, folder, asked.grade, samples=asked.samples)
        print(
            "  ".join(
                f"{key} {value:.1f}" if isinstance(value, float) else f"{key} {value}" for key, value in row.items()
            )
        )


if __name__ == "__main__":
    main()
