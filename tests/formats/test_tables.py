"""Tables and the place they go to."""

import csv
import errno
import os
import re
import stat
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.written import write_table

from skyproof.errors import OutputError
from skyproof.formats.atomic_write import write_lines, write_whole
from skyproof.formats.tables import FIXES_COLUMNS, build_fixes_columns
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.records import Fix, SignalId


def read_csv(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# --- tables


def make_columns():
    return {
        "receiver": np.array(["rx1", 'a "b", c', "Höjd"]),
        "gpst": np.array(["2022-01-01T21:45:58.25", "NaT", "2022-01-01T21:45:59"], "datetime64[ns]"),
        "range_m": np.array([0.1 + 0.2, np.nan, -1e-300]),
        "count": np.array([1, -2, 3]),
        "used": np.array([True, False, True]),
        "p_value": np.array([None, 0.5, None], object),
    }


def test_csv_holds_what_it_was_given(tmp_path):
    path = tmp_path / "a.csv"
    write_table(path, make_columns())
    rows = read_csv(path)
    assert list(rows[0]) == list(make_columns())
    assert [row["receiver"] for row in rows] == ["rx1", 'a "b", c', "Höjd"]
    assert [row["gpst"] for row in rows] == ["2022-01-01T21:45:58.250000000", "", "2022-01-01T21:45:59.000000000"]
    assert [row["range_m"] for row in rows] == ["0.30000000000000004", "", "-1e-300"]
    assert [row["count"] for row in rows] == ["1", "-2", "3"]
    assert [row["used"] for row in rows] == ["true", "false", "true"]
    assert [row["p_value"] for row in rows] == ["", "0.5", ""]


def test_parquet_holds_what_it_was_given(tmp_path):
    path = tmp_path / "a.parquet"
    write_table(path, make_columns())
    table = pq.read_table(path)
    assert table.column_names == list(make_columns())
    assert str(table.schema.field("gpst").type) == "timestamp[ns]"
    assert table.column("gpst").to_numpy()[[0, 2]].tolist() == make_columns()["gpst"][[0, 2]].tolist()
    assert table.column("range_m").to_pylist() == [0.30000000000000004, None, -1e-300]
    assert table.column("receiver").to_pylist() == make_columns()["receiver"].tolist()
    assert table.column("p_value").to_pylist() == [None, 0.5, None]


def test_instants_keep_their_nanoseconds(tmp_path):
    gpst = np.array(["2022-01-01T21:45:58.000000001", "2022-01-01T21:45:59"], "datetime64[ns]")
    write_table(tmp_path / "a.csv", {"gpst": gpst})
    assert [row["gpst"] for row in read_csv(tmp_path / "a.csv")] == [
        "2022-01-01T21:45:58.000000001",
        "2022-01-01T21:45:59.000000000",
    ]


@given(values=st.lists(st.floats(allow_nan=False), min_size=1, max_size=20))
def test_floats_read_back_to_the_bit(tmp_path_factory, values):
    path = tmp_path_factory.getbasetemp() / "floats.csv"
    write_table(path, {"x": np.array(values)})
    assert [float(row["x"]) for row in read_csv(path)] == values


def test_a_table_longer_than_a_block_is_whole(tmp_path):
    values = np.arange(20_000)
    write_table(tmp_path / "a.csv", {"n": values})
    assert [int(row["n"]) for row in read_csv(tmp_path / "a.csv")] == values.tolist()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_table_without_rows_keeps_its_columns(tmp_path, ending):
    path = tmp_path / f"fixes.{ending}"
    write_table(path, build_fixes_columns([]))
    names = pq.read_table(path).column_names if ending == "parquet" else path.read_text().strip().split(",")
    assert names == list(FIXES_COLUMNS)


def test_columns_of_unequal_length_are_refused(tmp_path):
    with pytest.raises(ValueError, match="one length"):
        write_table(tmp_path / "a.csv", {"a": np.zeros(2), "b": np.zeros(3)})
    assert not list(tmp_path.iterdir())


def test_another_ending_is_reported(tmp_path):
    with pytest.raises(OutputError, match=r"\.csv or \.parquet"):
        write_table(tmp_path / "a.xlsx", make_columns())


# --- the table of fixes


def make_fix(receiver="rx1", lat_deg=59.41, lon_deg=16.88, status=(0, 0, 2), sigma_m=(1.0, 2.0, 5.0)):
    """Make three epochs of six signals of five satellites, with a covariance built in east, north, up."""
    lat_rad, lon_rad = np.radians(lat_deg), np.radians(lon_deg)
    rot = rot_enu_ecef(lat_rad, lon_rad)
    covariance_m2 = np.eye(4)
    covariance_m2[:3, :3] = rot.T @ np.diag(np.square(sigma_m)) @ rot
    good = (np.array(status) == 0)[:, np.newaxis]
    residual_m = np.ones((3, 6))
    residual_m[1, 0] = np.nan  # the other copy of that satellite is used still
    residual_m[1, 2] = np.nan
    names = ("G05a", "G05b", "G07a", "G08a", "G10a", "G13a")
    return Fix(
        receiver=receiver,
        signals=tuple(SignalId(name[:3], copy=name[3]) for name in names),
        gpst=np.datetime64("2022-01-01T21:45:58", "ns") + np.arange(3) * np.timedelta64(1, "s"),
        position_ecef_m=np.where(good, ecef_from_geodetic(lat_rad, lon_rad, 52.0), np.nan),
        velocity_ecef_m_s=np.zeros((3, 3)),
        clock_bias_s=np.full(3, 1e-3),
        clock_drift=np.zeros(3),
        covariance_m2=np.broadcast_to(covariance_m2, (3, 4, 4)),
        residual_m=residual_m,
        status=np.array(status, np.uint8),
    )


def test_fixes_have_the_columns_of_the_design():
    assert ",".join(FIXES_COLUMNS) == (
        "receiver,gpst,kind,lat_deg,lon_deg,height_m,sigma_east_m,sigma_north_m,sigma_up_m,clock_bias_m,satellites,"
        "horizontal_protection_m,vertical_protection_m,hidden_m"
    )
    assert tuple(build_fixes_columns([("trusted", make_fix())])) == FIXES_COLUMNS


def test_an_epoch_with_a_fix_is_a_row():
    table = build_fixes_columns([("trusted", make_fix()), ("false", make_fix("rx2", -33.5, -70.25, status=(1, 0, 0)))])
    assert table["receiver"].tolist() == ["rx1", "rx1", "rx2", "rx2"]
    assert table["kind"].tolist() == ["trusted", "trusted", "false", "false"]
    assert table["gpst"].astype(str).tolist() == [f"2022-01-01T21:45:{s}.000000000" for s in ("58", "59", "59")] + [
        "2022-01-01T21:46:00.000000000"
    ]
    np.testing.assert_allclose(table["lat_deg"], [59.41, 59.41, -33.5, -33.5], atol=1e-12)
    np.testing.assert_allclose(table["lon_deg"], [16.88, 16.88, -70.25, -70.25], atol=1e-12)
    np.testing.assert_allclose(table["height_m"], 52.0, atol=1e-6)
    np.testing.assert_allclose(table["clock_bias_m"], 299792.458, rtol=1e-12)
    assert table["satellites"].tolist() == [5, 4, 4, 5]


def test_sigmas_are_east_north_up():
    table = build_fixes_columns([("trusted", make_fix(lat_deg=-20.0, lon_deg=130.0))])
    np.testing.assert_allclose(table["sigma_east_m"], 1.0, rtol=1e-9)
    np.testing.assert_allclose(table["sigma_north_m"], 2.0, rtol=1e-9)
    np.testing.assert_allclose(table["sigma_up_m"], 5.0, rtol=1e-9)


def test_a_protection_level_that_is_not_promised_is_empty():
    fix = replace(make_fix(), protection_m=np.array([[3.0, 5.0], [np.nan, 6.0], [np.nan, np.nan]]))
    table = build_fixes_columns([("trusted", fix), ("false", make_fix())])
    np.testing.assert_array_equal(table["horizontal_protection_m"], [3.0, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(table["vertical_protection_m"], [5.0, 6.0, np.nan, np.nan])


def test_csv_and_parquet_of_the_fixes_agree(tmp_path):
    table = build_fixes_columns([("trusted", make_fix())])
    write_table(tmp_path / "fixes.csv", table)
    write_table(tmp_path / "fixes.parquet", table)
    from_parquet = pq.read_table(tmp_path / "fixes.parquet").to_pylist()
    for row, other in zip(read_csv(tmp_path / "fixes.csv"), from_parquet, strict=True):
        assert np.datetime64(row["gpst"]) == np.datetime64(other["gpst"])
        assert float(row["lat_deg"]) == other["lat_deg"]
        assert int(row["satellites"]) == other["satellites"]
        assert re.fullmatch(r"2022-01-01T21:45:5[89]\.000000000", row["gpst"])


# --- the place


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def break_off():
        with write_whole(path) as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        break_off()
    assert path.read_text() == "old"
    with write_whole(path) as file:
        file.write(b"new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_new_file_has_the_usual_permissions(tmp_path):
    write_lines(tmp_path / "ours", ["a"])
    (tmp_path / "usual").write_text("a")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_link_keeps_pointing(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_lines(tmp_path / "link", ["a", "b"])
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "a\nb\n"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gone/a.csv", "its folder"),
        ("file/a.csv", "not a folder"),
        ("folder.csv", "is a folder"),
        ("x" * 300 + ".csv", "shorter"),
    ],
    ids=["no folder", "a file for a folder", "a folder", "too long"],
)
def test_a_place_that_cannot_be_written_has_a_remedy(tmp_path, name, words):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(OutputError, match=words) as raised:
        write_table(tmp_path / name, {"a": np.zeros(2)})
    assert str(tmp_path / name) in str(raised.value)


def test_a_folder_without_permission_is_reported(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "replace", refuse)  # the superuser may write anywhere, so a real folder would not do
    with pytest.raises(OutputError, match="permissions"):
        write_lines(tmp_path / "a", ["a"])
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_reported(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(OutputError, match="disk"):
        write_lines(tmp_path / "a", ["a"])
    assert not list(tmp_path.iterdir())


def test_a_device_is_not_replaced_by_a_file():
    with pytest.raises(OutputError, match="regular"):
        write_lines("/dev/null", ["a"])
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_table_in_parquet_needs_no_pandas(tmp_path):
    script = (
        "import sys, numpy as np; from skyproof.formats.tables import Words, open_growing_tables\n"
        f"with open_growing_tables([{str(tmp_path / 'table.parquet')!r}]) as take:\n"
        "    words = Words(np.array([2, 0]), ['a', 'bc', 'é'])\n"
        "    texts = np.array(['x', None], object)\n"
        "    take({'real': np.array([1.0, np.nan]), 'text': texts, 'words': words, 'open': np.array([False, True])})\n"
        "assert not {'pandas', 'pyarrow.compute'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
    table = pq.read_table(tmp_path / "table.parquet").to_pydict()
    assert table == {"real": [1.0, None], "text": ["x", None], "words": ["é", "a"], "open": [False, True]}
