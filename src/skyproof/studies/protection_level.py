"""Is a fix beyond its protection level as rarely as promised? Epochs of measurements, clean and with one fault.

The level is promised for one satellite that is wrong by any amount. The fault here is on the satellite whose bias moves
the position farthest for what its residual shows; errors are those that the fix takes its measurements to have. Risks
are asked that can be counted. What a run promises, 1e-7, follows by the same formula only if errors are Gaussian as far
out; that cannot be counted.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from scipy import special

from skyproof.arrays import Indices, Reals
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.navigation.fix import FixGeometry, fix_and_geometry
from skyproof.navigation.protection import add_protection
from skyproof.navigation.raim import fit_whitened
from skyproof.navigation.screen import reject_misfits
from skyproof.records import Fix, FixStatus, NavigationData, Observations
from skyproof.report.chart import Axes
from skyproof.simulator.measurements import draw, make_ideal_measurements
from skyproof.simulator.scenario import ScenePlace
from skyproof.simulator.scenes import make_clean
from skyproof.simulator.sky import make_scene
from skyproof.studies.base import Row, Study, StudySettings

__all__ = ["STUDIES"]

RISKS: Final = (1e-2, 1e-3)
BIASES_SIGMA: Final = (0.0, 2.0, 3.0, 4.0, 4.5, 5.0, 5.5, 6.0, 7.0, 8.0, 30.0)
"""Of the residual's own test, whose threshold is near 5: a smaller bias moves less, a larger one gives the alarm."""
QUICK_BIASES_SIGMA: Final = (0.0, 4.0, 5.0, 6.0, 7.0, 30.0)
AXES: Final = {"horizontal": slice(0, 2), "vertical": slice(2, 3)}
SKY_S: Final = 61.0
EPOCHS: Final = 60
MULTIPATH_M: Final = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class _Sky:
    """Exact observations of a receiver somewhere, and where it is."""

    exact: Observations
    navigation: NavigationData
    place_ecef_m: Reals

    @property
    def rot_enu(self) -> Reals:
        return rot_enu_ecef(*geodetic_from_ecef(self.place_ecef_m)[:2])

    def compute_fix(self, error_m: Reals | float) -> tuple[Fix, FixGeometry]:
        """Compute fixes as trusted ones are made of smoothed observations: `fusion.trusted.fix_of`."""
        observed = replace(self.exact, pseudorange_m=self.exact.pseudorange_m + error_m)
        found, geometry = fix_and_geometry(observed, self.navigation, multipath_sigma_m=MULTIPATH_M)
        return reject_misfits(found, geometry), geometry


def rows(settings: StudySettings) -> Iterator[Row]:
    """Count how many fixes are beyond the level, beside the risk asked.

    Without a fault also how many are beyond the same quantile of the covariance, which is exact on one axis.
    """
    rng, trials = settings.rng(), settings.count(40_000, 3000)
    skies = [_somewhere(rng, number) for number in range(4 if settings.quick else 20)]
    times = max(round(trials / (EPOCHS * len(skies))), 1)
    counted = [_count_fixes(sky, times, rng, QUICK_BIASES_SIGMA if settings.quick else BIASES_SIGMA) for sky in skies]
    for each in zip(*counted, strict=True):
        yield _row(each)


def _somewhere(rng: np.random.Generator, seed: int) -> _Sky:
    """Draw a place between 70 S and 70 N, at any time of four years."""
    place = ScenePlace(
        lat_deg=float(np.degrees(np.arcsin(rng.uniform(-0.94, 0.94)))),
        lon_deg=float(rng.uniform(-180.0, 180.0)),
        height_m=float(rng.uniform(0.0, 1500.0)),
    )
    start = np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s")
    scenario = make_clean(place, start, duration_s=SKY_S, receivers=1, mask_deg=8.0, seed=seed)
    navigation = make_nominal_constellation(start)
    scene = make_scene(scenario, navigation)
    ideal = make_ideal_measurements(scene)
    (observed,), _ = draw(ideal, rng=rng)
    order = [ideal[0].signals.index(signal) for signal in observed.signals]
    return _Sky(
        exact=replace(observed, pseudorange_m=ideal[0].pseudorange_m[:, order]),
        navigation=navigation,
        place_ecef_m=scene.skies[0].point(np.zeros(1)).position_ecef_m[0],
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Count:
    """One sky's fixes under one fault: sizes_m (n,) of errors along the axes, levels_m (n,), covariance_m (n,)."""

    axis: str
    risk: float
    bias_sigma: float
    sizes_m: Reals
    levels_m: Reals
    covariance_m: Reals


def _count_fixes(sky: _Sky, times: int, rng: np.random.Generator, biases_sigma: tuple[float, ...]) -> list[_Count]:
    many = replace(sky, exact=_repeat_epochs(sky.exact, times))
    _, geometry = many.compute_fix(0.0)
    counts = []
    for number, (axis, of) in enumerate(AXES.items()):
        column, metres = _hardest(geometry, sky.rot_enu, of)
        for bias_sigma in biases_sigma:
            error_m = geometry.sigma_m * rng.standard_normal(geometry.sigma_m.shape)
            error_m[np.arange(len(column)), column] += bias_sigma * metres
            found, problem = many.compute_fix(error_m)
            good = found.status == FixStatus.OK
            off_m = (found.position_ecef_m - sky.place_ecef_m) @ sky.rot_enu.T
            for risk in RISKS:
                counts.append(
                    _Count(
                        axis=axis,
                        risk=risk,
                        bias_sigma=bias_sigma,
                        sizes_m=np.where(good, np.linalg.norm(off_m[:, of], axis=1), np.nan),
                        levels_m=add_protection(found, problem, integrity_risk=risk).protection_m[:, number],
                        covariance_m=_quantile(axis, risk) * _sigma_m(found, sky.rot_enu, of),
                    )
                )
    return counts


def _quantile(axis: str, risk: float) -> float:
    """Return the quantile in sigmas of the larger axis."""
    return float(np.sqrt(-2.0 * np.log(risk)) if axis == "horizontal" else -special.ndtri(0.5 * risk))


def _sigma_m(found: Fix, rot_enu: Reals, of: slice) -> Reals:
    """Return the larger sigma of the axes, (n,)."""
    enu_m2 = (rot_enu @ found.covariance_m2[:, :3, :3] @ rot_enu.T)[:, of, of]
    sigma_m = np.full(len(enu_m2), np.nan)
    good = np.isfinite(enu_m2).all(axis=(1, 2))
    sigma_m[good] = np.sqrt(np.linalg.eigvalsh(enu_m2[good])[:, -1])
    return sigma_m


def _repeat_epochs(o: Observations, times: int) -> Observations:
    """Repeat each epoch so often."""
    per_epoch: dict[str, Any] = {
        f.name: np.repeat(getattr(o, f.name), times, axis=0)
        for f in fields(o)
        if isinstance(getattr(o, f.name), np.ndarray) and getattr(o, f.name).shape[:1] == (len(o.gpst),)
    }
    return replace(o, **per_epoch)


def _hardest(geometry: FixGeometry, rot_enu: Reals, of: slice) -> tuple[Indices, Reals]:
    """Find the satellite that moves the position farthest for what its residual shows, (n,)."""
    _, redundancy, covariance = fit_whitened(geometry.design, geometry.misfit_m, geometry.sigma_m)
    whitened = np.nan_to_num(geometry.design / geometry.sigma_m[..., None])
    gain = (rot_enu @ (covariance @ np.swapaxes(whitened, -1, -2))[:, :3])[:, of]
    tested = redundancy > 1e-6
    harm = np.where(tested, np.linalg.norm(gain, axis=1) / np.sqrt(np.where(tested, redundancy, 1.0)), 0.0)
    column = np.argmax(harm, axis=1)
    cell = np.arange(len(column)), column
    return column, np.where(tested[cell], geometry.sigma_m[cell] / np.sqrt(redundancy[cell]), 0.0)


def _row(each: tuple[_Count, ...]) -> Row:
    """Build a row over all skies."""
    first = each[0]
    sizes_m, levels_m, covariance_m = (
        np.concatenate([getattr(count, name) for count in each]) for name in ("sizes_m", "levels_m", "covariance_m")
    )
    has_level = np.isfinite(levels_m)
    beyond = int(np.sum(sizes_m > levels_m))
    return {
        "axis": first.axis,
        "integrity_risk": first.risk,
        "bias_sigma": first.bias_sigma,
        "trials": sizes_m.size,
        "with_level": float(has_level.mean()),
        "protection_p50_m": float(np.median(levels_m[has_level])) if has_level.any() else None,
        "error_p50_m": float(np.nanmedian(sizes_m)) if np.isfinite(sizes_m).any() else None,
        "beyond": beyond,
        "share_beyond": beyond / sizes_m.size,
        "share_beyond_covariance": None if first.bias_sigma else float(np.mean(sizes_m > covariance_m)),
    }


STUDIES: tuple[Study, ...] = (
    Study(
        name="protection-level",
        title="How often a fix is beyond its protection level without an alarm, while one satellite is wrong",
        paper="skyproof",
        figure="protection level",
        run=rows,
        charts=(
            Axes(
                title="Fixes beyond their protection level, no alarm",
                x="bias_sigma",
                y="share_beyond",
                x_label="bias of one satellite, sigmas of its test",
                y_label="share of fixes",
                by=("axis", "integrity_risk"),
                y_log=True,
            ),
            Axes(
                title="Fixes that are promised a level",
                x="bias_sigma",
                y="with_level",
                x_label="bias of one satellite, sigmas of its test",
                y_label="share of fixes",
                by=("axis",),
                where={"integrity_risk": RISKS[0]},
            ),
        ),
    ),
)
