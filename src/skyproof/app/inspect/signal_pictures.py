"""The pictures of `skyproof inspect --plot`, as files."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from skyproof.app.common.folder import require_free
from skyproof.errors import OutputError
from skyproof.formats.atomic_write import write_lines
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.recording.conditioning import condition
from skyproof.recording.lobes import CELLS_PER_CHIP, compute_correlation_power
from skyproof.report.signal import Lobe, Mark, draw_correlation_svg, draw_levels_svg, draw_spectrum_svg

if TYPE_CHECKING:
    from skyproof.app.inspect.inspection import Inspection

__all__ = ["write_pictures"]

_CORRELATED_S: Final = 20.0 * GPS_L1_CA.period_s
_PICTURES: Final = ("levels", "spectrum", "correlation")


def write_pictures(
    inspections: "Sequence[Inspection]", folder: str | Path, *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write NAME-levels.svg, NAME-spectrum.svg and, where there are satellites, NAME-correlation.svg of each channel.

    Raises OutputError if the folder cannot be made, a file cannot be written, or one is there already and may not be
    replaced (`overwrite`).
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be made ({error.strerror or error}); give --out a folder that can"
        ) from error
    names = [f"{each.samples.name}-{kind}.svg" for each in inspections for kind in _PICTURES]
    taken = [name for name in names if (folder / name).exists()]
    require_free(folder, taken, taken, "pictures already", overwrite=overwrite)
    paths = []
    for inspection in inspections:
        front = inspection.front_end
        marks = [Mark(line.frequency_hz, _top(inspection, line.frequency_hz), line.hurts) for line in front.lines]
        pictures = (
            draw_levels_svg(front.levels, front.level_shares),
            draw_spectrum_svg(front.frequency_hz, front.density, front.floor, marks),
            draw_correlation_svg(_correlate_lobes(inspection)),
        )
        for kind, picture in zip(_PICTURES, pictures, strict=True):
            if picture:
                paths.append(folder / f"{inspection.samples.name}-{kind}.svg")
                write_lines(paths[-1], [str(picture)], end="", encoding="utf-8")
    return tuple(paths)


def _top(inspection: "Inspection", frequency_hz: float) -> float:
    at = int(np.argmin(np.abs(inspection.front_end.frequency_hz - frequency_hz)))
    return float(inspection.front_end.density[max(at - 2, 0) : at + 3].max())


def _correlate_lobes(inspection: "Inspection") -> list[Lobe]:
    """Correlate the stretch that was searched, in the right reading of the spectrum."""
    begin, end = inspection.stretch
    count = min(end - begin, round(_CORRELATED_S * inspection.samples.rate_hz))
    planes = condition(inspection.samples, inspection.front_end).read(begin, count)
    turned = -1.0 if inspection.conjugate else 1.0
    if inspection.conjugate:
        planes = np.stack([planes[0], -planes[1]])
    if inspection.front_end.real:
        turned = abs(turned)
    carrier_hz = turned * inspection.front_end.carrier_hz
    powers = compute_correlation_power(
        planes,
        inspection.samples.rate_hz,
        {satellite.sat: carrier_hz + satellite.doppler_hz for satellite in inspection.satellites},
    )
    return [
        Lobe(
            sat=satellite.sat,
            delay_chips=np.arange(powers[satellite.sat].size) / CELLS_PER_CHIP,
            power=powers[satellite.sat],
            cn0_dbhz=satellite.cn0_dbhz,
            peaks=satellite.peaks,
        )
        for satellite in inspection.satellites
    ]
