"""Recordings that begin or end at different times, as those of two recorders that are started and stopped by hand."""

import numpy as np
import pytest
from tests.app import kit

from skyproof.app.protect import protect
from skyproof.simulator.scenario import FrontEnd

RATE_HZ = 1_600_000
SECONDS = 33.0
FRONT_END = FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=1.28e6, encoding="int", bits=8)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    scenario = kit.make_scenario(duration_s=SECONDS, front_end=FRONT_END)
    return kit.record(scenario, tmp_path_factory.mktemp("spans"))


@pytest.mark.long
@pytest.mark.parametrize(("from_s", "to_s"), [(0.0, 7.5), (0.0, 12.0), (0.0, 20.0), (14.0, SECONDS), (21.0, SECONDS)])
@pytest.mark.parametrize("which", [0, 1])
def test_only_the_span_that_both_received_is_tested(recordings, tmp_path, from_s, to_s, which):
    paths = list(recordings.paths)
    samples = np.fromfile(paths[which], np.int8)
    paths[which] = tmp_path / paths[which].name
    samples[2 * int(from_s * RATE_HZ) : 2 * int(to_s * RATE_HZ)].tofile(paths[which])
    described = recordings.paths[which].with_suffix(".toml").read_text(encoding="utf-8")
    lines = [line for line in described.splitlines() if not line.startswith("start_gpst")]
    paths[which].with_suffix(".toml").write_text("\n".join(lines), encoding="utf-8")
    result = protect(paths, nav=recordings.nav, antenna_distance_m=kit.DISTANCE_M, out=tmp_path / "out")
    decision = result.outcome.decision
    assert decision.verdict == "authentic"
    other = recordings.paths[1 - which].stem
    ((alone, seconds),) = decision.alone_s
    assert alone == other
    assert seconds == pytest.approx(SECONDS - (to_s - from_s), abs=1.0)
    unvouched = [s for s in decision.labels if s.ref.receiver == other and s.label == "unknown"]
    assert unvouched
