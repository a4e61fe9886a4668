"""`protect --platform`: inputs, names and places of the receivers come from the file, and what is not used is said."""

from pathlib import Path

import numpy as np
import pytest
from tests.app import kit
from tests.app.kit import ENU_M, PLACES

from skyproof.app.protect import protect
from skyproof.errors import InputError, SettingsError
from skyproof.formats.byte_io import compute_sha256
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a minute of two receivers as one.obs and two.obs, and the navigation file."""
    folder = tmp_path_factory.mktemp("platform")
    navigation, pair = kit.simulate_measurements(61.0)
    for name, o in zip(("one", "two"), pair, strict=True):
        write_obs(folder / f"{name}.obs", o, signals=o.signals, holds="simulated", marker=name, version="test")
    write_nav(folder / "brdc.rnx", navigation)
    return folder


def write_platform(folder: Path, *, inputs: bool = True, more: str = "") -> Path:
    lines = [more]
    for place, name in zip(PLACES, ("one", "two"), strict=False):
        where = f"lat_deg = {place.lat_deg}, lon_deg = {place.lon_deg}, height_m = {place.height_m}, sigma_m = 0.1"
        lines += ["[[receivers]]", f'name = "{place.name if inputs else name}"', f"position = {{ {where} }}"]
        lines += [f'inputs = ["{name}.obs"]'] if inputs else []
    (folder / "platform.toml").write_text("\n".join(lines), encoding="utf-8")
    return folder / "platform.toml"


def test_a_platform_file_is_all_that_a_run_needs(folder: Path, tmp_path: Path) -> None:
    path = write_platform(folder, more='oscillator = "tcxo"\nmotion = "static"')
    result = protect(platform=path, nav=folder / "brdc.rnx", out=tmp_path / "out")
    assert [r.name for r in result.verdict.receivers] == ["bow", "stern"]
    assert result.verdict.verdict == "authentic"
    np.testing.assert_allclose(result.verdict.settings["antennas_enu_m"]["stern"], ENU_M["stern"], atol=1e-6)
    assert result.verdict.settings["speed_max_m_s"] == 0.0
    note = result.verdict.inputs[-1]
    assert (note.path, note.format, note.sha256) == (str(path), "platform", compute_sha256(path))
    assert list(note.all_remarks) == []
    assert result.verdict.settings["oscillator"] == "tcxo"


def test_signals_that_agree_on_another_place_are_not_authentic(folder: Path) -> None:
    # Both places 200 m too far north: how the antennas stand to each other is right.
    path = write_platform(folder)
    for place in PLACES:
        path.write_text(path.read_text().replace(f"{place.lat_deg},", f"{place.lat_deg + 1.8e-3},"))
    result = protect(platform=path, nav=folder / "brdc.rnx")
    assert result.verdict.verdict == "suspect"
    off = [e for e in result.outcome.evidence if e.detector == "place"]
    assert {(e.code, e.data["surveyed"]) for e in off} == {("never_there", True)}
    assert [e.data["statistic"] for e in off] == pytest.approx([200.0] * len(off), abs=5.0)


def test_inputs_of_the_command_line_are_described_by_name(folder: Path) -> None:
    path = write_platform(folder, inputs=False)
    files = [folder / "two.obs", folder / "one.obs"]
    result = protect(files, platform=path, nav=folder / "brdc.rnx")
    assert [r.name for r in result.verdict.receivers] == ["two", "one"]
    np.testing.assert_allclose(
        np.subtract(*(result.verdict.settings["antennas_enu_m"][name] for name in ("two", "one"))),
        np.subtract(*(ENU_M[name] for name in ("stern", "bow"))),
        atol=2e-3,  # the two places' east and north differ by their distance over the Earth's radius
    )
    with pytest.raises(SettingsError, match=r"platform\.toml: receivers\[1\] is two, .*\bone\b"):
        protect([folder / "one.obs"], platform=path, nav=folder / "brdc.rnx")


def test_inputs_in_two_places_and_in_none_are_refused(folder: Path) -> None:
    with pytest.raises(SettingsError, match=r"platform\.toml: receivers\[0\] .*command line"):
        protect([folder / "one.obs"], platform=write_platform(folder))
    with pytest.raises(InputError, match="no input"):
        protect()


def test_a_missing_input_is_named_beside_the_platform_file(folder: Path) -> None:
    path = folder / "platform.toml"
    path.write_text('[[receivers]]\ninputs = ["none.obs"]\n', encoding="utf-8")
    with pytest.raises(InputError, match=str(folder / "none.obs")):
        protect(platform=path)
