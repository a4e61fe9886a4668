"""Inputs that end early: what was whole is used, and a remark of the kind `CUT` says where it ends."""

import gzip
import json

import numpy as np
import pytest
from tests.formats.test_rinex_obs_pieces import VERSION_3, join_pieces, make_file_2, make_file_3
from tests.fuzz.readers import READERS
from tests.written import write_table

from skyproof.app.receive.inputs import cut_stretch
from skyproof.app.receive.observed import open_observations
from skyproof.formats.attitude import read_attitude
from skyproof.formats.bounds import REMARKS, Remarks, limit_remarks
from skyproof.formats.byte_io import FileBytes
from skyproof.formats.imu import COLUMNS, read_imu
from skyproof.formats.raw import open_raw
from skyproof.formats.rinex_obs_pieces import read_obs_pieces
from skyproof.formats.rinex_obs_read import parse_obs
from skyproof.formats.sigmf import open_sigmf
from skyproof.remarks import Remark, RemarkKind

SIDECAR = '[samples]\nrate_hz = 1e6\nkind = "complex"\nencoding = "int"\nbits = 8\n'
HEAD_OF_COMPACT = [
    f"{'3.0                 COMPACT RINEX FORMAT':60}CRINEX VERS   / TYPE",
    f"{'':60}CRINEX PROG / DATE",
    *VERSION_3,
]


def find_worst(remarks):
    """Return the gravest kind among remarks."""
    return max(map(Remark.kind_of, remarks), default=RemarkKind.NOTE)


def read_pieces(content):
    """Read the observations of a file and all its remarks."""
    found = list(read_obs_pieces([content], source="a.obs"))
    return join_pieces(found), [remark for piece in found for remark in piece.remarks]


def is_epoch_start(rest):
    return rest[:1] == b">" or rest[:4] == b" 24 " or not rest


@pytest.mark.parametrize("content", [make_file_3(4), make_file_2(4)], ids=["3", "2"])
def test_observations_cut_anywhere_say_that_they_are_cut(content):
    first = content.index(b"\n", content.index(b"10 00  1.0" if b"3.05" in content[:80] else b"10  0  1.0"))
    whole, remarks = read_pieces(content)
    assert find_worst(remarks) is RemarkKind.NOTE
    for end in range(first, len(content)):
        for parsed in (read_pieces, lambda part: (lambda file: (file.observations, file.remarks))(parse_obs(part))):
            seen, remarks = parsed(content[:end])
            between_epochs = content[end - 1 : end] == b"\n" and is_epoch_start(content[end:])
            assert find_worst(remarks) is (RemarkKind.NOTE if between_epochs else RemarkKind.CUT), content[:end][-80:]
            cut_m, whole_m = seen.pseudorange_m, whole.pseudorange_m[: seen.gpst.size]
            present = np.isfinite(cut_m)
            assert np.array_equal(cut_m[present], whole_m[:, [whole.signals.index(s) for s in seen.signals]][present])


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_a_gzip_file_that_is_cut_counts_up_to_there(share):
    content = gzip.compress(make_file_3(400))
    whole, _ = read_pieces(content)
    seen, remarks = read_pieces(content[: int(share * len(content))])
    assert 0.8 * share * 400 < seen.gpst.size <= 400
    assert find_worst(remarks) is RemarkKind.CUT
    assert np.array_equal(seen.pseudorange_m[0], whole.pseudorange_m[0, : len(seen.signals)], equal_nan=True)


def make_compact(n_epochs):
    lines = ["> 2024 05 14 10 00 00.0000000  0  2      G05G07", ""]
    lines += [f"1&{number}0000000000 1&1000 1&-500000 1&44000" for number in (2, 3)]
    for second in range(1, n_epochs):
        tens = f"{second // 10}{second % 10}" if second % 10 == 0 else f" {second % 10}"
        lines += [f"{'':19}{tens}", "", "123456 1000 0 0", "234567 1000 0 0"]
    return "\n".join([*HEAD_OF_COMPACT, *lines, ""]).encode()


def test_compact_observations_cut_anywhere_say_that_they_are_cut():
    content = make_compact(4)
    whole, remarks = read_pieces(content)
    assert whole.gpst.size == 4
    assert find_worst(remarks) is RemarkKind.NOTE
    ends, lines = [], content.split(b"\n")
    for line in range(len(HEAD_OF_COMPACT) + 4, len(lines), 4):
        ends.append(len(b"\n".join(lines[:line])) + 1)
    for end in range(ends[0], len(content)):
        seen, remarks = read_pieces(content[:end])
        assert find_worst(remarks) is (RemarkKind.NOTE if end in ends else RemarkKind.CUT), content[:end][-60:]
        assert seen.gpst.size == sum(end >= start for start in ends)
        np.testing.assert_array_equal(seen.pseudorange_m, whole.pseudorange_m[: seen.gpst.size])


@pytest.mark.parametrize("name", ["compact-1.21d", "compact-3.crx"])
def test_compact_files_without_a_fault_are_not_cut(name):
    seed = READERS["compact"].seeds[0 if name.endswith("d") else 1]
    content = seed if seed.endswith(b"\n") else seed + b"\n"
    assert find_worst(parse_obs(content).remarks) < RemarkKind.CUT


def test_a_header_that_states_later_epochs_bears_on_the_answer():
    last = f"{'  2024     5    14    10    30    0.0000000     GPS':60}TIME OF LAST OBS"
    content = b"\n".join([*make_file_3(4).split(b"\n")[:2], last.encode(), *make_file_3(4).split(b"\n")[2:]])
    _, remarks = read_pieces(content)
    assert find_worst(remarks) is RemarkKind.BEARS
    assert any("2024-05-14 10:30:00" in remark for remark in remarks)


def test_remarks_on_header_and_damage_reach_readers_of_pieces():
    broken = f"{'   x':60}LEAP SECONDS".encode()
    content = b"\n".join([*make_file_3(4).split(b"\n")[:2], broken, *make_file_3(4).split(b"\n")[2:]])
    _, remarks = read_pieces(content)
    assert any("LEAP SECONDS" in remark and Remark.kind_of(remark) for remark in remarks)
    damaged = make_compact(6).replace(b"1&20000000000", b"1&2000000000x", 1).replace(b"\n\n123456", b"\nx\n\n123456", 1)
    _, remarks = read_pieces(damaged)
    assert find_worst(remarks) is RemarkKind.BEARS


def test_an_empty_line_at_the_end_is_no_damage():
    _, remarks = read_pieces(make_file_3(4) + b"\n")
    assert find_worst(remarks) is RemarkKind.NOTE


def test_a_part_before_the_cut_is_whole(tmp_path):
    path = tmp_path / "a.obs"
    path.write_bytes(make_file_3(20)[:-30])
    assert find_worst(open_observations(path).remarks) is RemarkKind.CUT
    assert find_worst(open_observations(path, start_s=2.0, duration_s=5.0).remarks) is RemarkKind.NOTE
    assert find_worst(open_observations(path, start_s=2.0, duration_s=50.0).remarks) is RemarkKind.CUT
    samples = cut_samples(tmp_path)
    assert find_worst(cut_stretch(samples, 0.0, 0.004).remarks) is RemarkKind.NOTE
    assert find_worst(cut_stretch(samples, 0.001, None).remarks) is RemarkKind.CUT


def draw_noise(n_bytes):
    return np.random.default_rng(3).integers(0, 256, n_bytes, dtype=np.uint8).tobytes()


def cut_samples(folder):
    (folder / "rx.toml").write_text(SIDECAR)
    (folder / "rx.bin").write_bytes(draw_noise(10_001))
    return open_raw(folder / "rx.bin")


def test_samples_that_end_within_one_are_cut(tmp_path):
    assert find_worst(cut_samples(tmp_path).remarks) is RemarkKind.CUT
    (tmp_path / "rx.bin").write_bytes(draw_noise(10_000))
    assert find_worst(open_raw(tmp_path / "rx.bin").remarks) is RemarkKind.NOTE


def test_samples_shorter_than_their_captures_are_cut(tmp_path):
    captures = [{"core:sample_start": start, "core:frequency": 1575.42e6} for start in (0, 4000)]
    meta = {"global": {"core:datatype": "ci8", "core:sample_rate": 1e6, "core:version": "1.0.0"}}
    (tmp_path / "rx.sigmf-meta").write_text(json.dumps({**meta, "captures": captures, "annotations": []}))
    for n_bytes, kind in ((10_000, RemarkKind.NOTE), (7_000, RemarkKind.CUT), (9_001, RemarkKind.CUT)):
        (tmp_path / "rx.sigmf-data").write_bytes(draw_noise(n_bytes))
        (opened,) = open_sigmf(tmp_path / "rx.sigmf-meta")
        assert find_worst(opened.remarks) is kind


def test_a_file_that_ends_elsewhere_than_when_opened_is_cut(tmp_path):
    path = tmp_path / "rx.bin"
    for content, changed in ((b"ab", b"abc"), (b"ab", b"a")):
        path.write_bytes(content)
        opened = FileBytes(path)
        assert opened.changes() == ()
        path.write_bytes(changed)
        assert find_worst(opened.changes()) is RemarkKind.CUT
    opened = FileBytes(path)
    path.unlink()
    assert find_worst(opened.changes()) is RemarkKind.NOTE


def make_table(n_rows, values):
    return {"time_s": 0.01 * np.arange(n_rows), **values}


@pytest.mark.parametrize("chopped", range(1, 90, 4))
def test_a_table_of_readings_cut_within_a_row_ends_before_it(tmp_path, chopped):
    force = np.random.default_rng(1).normal((0.0, 0.0, -9.8), 0.01, (100, 3))
    rate = np.random.default_rng(2).normal(0.0, 0.01, (100, 3))
    path = tmp_path / "imu.csv"
    write_table(path, make_table(100, dict(zip(COLUMNS, np.hstack([force, rate]).T, strict=True))))
    whole = read_imu(path)
    assert find_worst(whole.remarks) is RemarkKind.NOTE
    content = path.read_bytes()
    path.write_bytes(content[:-chopped])
    found = read_imu(path)
    row = content[:-chopped].rpartition(b"\n")[2]
    n_whole = 100 if row.count(b",") == 6 and not row.endswith((b",", b"-", b"e")) else 99
    assert found.time_ns.size == n_whole
    assert find_worst(found.remarks) is (RemarkKind.NOTE if n_whole == 100 else RemarkKind.CUT)


def test_a_table_of_angles_cut_within_a_row_ends_before_it(tmp_path):
    path = tmp_path / "attitude.csv"
    path.write_text("time_s,heading_deg,pitch_deg,roll_deg\n0,1,2,3\n1,1,2,3\n2,1,2")
    found = read_attitude(path)
    assert found.time_ns.size == 2
    assert find_worst(found.remarks) is RemarkKind.CUT


def test_the_gravest_remarks_are_never_among_the_others():
    notes = [f"note {k}" for k in range(30)]
    bearing = [Remark(f"left out {k}", RemarkKind.BEARS) for k in range(30)]
    cut = Remark("cut", RemarkKind.CUT)
    kept = limit_remarks([*notes, *bearing, *notes, cut], "more")
    assert kept[0] == cut
    assert [Remark.kind_of(item) for item in kept] == [2] + (REMARKS + 1) * [1] + (REMARKS + 1) * [0]
    assert kept[REMARKS + 1] == kept[-1] == "20 more"


def test_remarks_of_one_kind_are_counted_beyond_the_first():
    remarks = Remarks()
    for k in range(REMARKS + 3):
        remarks.add(f"line {k}")
    assert find_worst(remarks.words("more")) is RemarkKind.BEARS
    assert remarks.words("more")[-1] == "3 more"


def test_another_text_keeps_the_kind():
    assert Remark.kind_of(Remark.reword(Remark("a", RemarkKind.CUT), "b")) is RemarkKind.CUT
    assert type(Remark.reword("a", "b")) is str
