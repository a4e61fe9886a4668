"""A catalogue's lines, what an item depends on, the table and page over all; whole fleets in the long tests."""

import dataclasses
import os
import random
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from skyproof.app.fleet import FleetResult, fleet
from skyproof.app.fleet.catalogue import CatalogueItem, read_catalogue
from skyproof.app.fleet.piece import make_piece
from skyproof.app.fleet.rows import FleetRow, make_row, write_rows
from skyproof.app.scenes.simulate import simulate
from skyproof.errors import InputError, OutputError, SettingsError, SkyproofError
from skyproof.report.fleet import write_fleet_html

SAMPLE = Path(__file__).parent.parent / "formats" / "verdict-sample.json"


def write_catalogue(folder: Path, *lines: str, encoding: str = "utf-8") -> Path:
    path = folder / "catalogue.csv"
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def test_a_line_is_what_protect_takes(tmp_path: Path) -> None:
    path = write_catalogue(
        tmp_path,
        "name, inputs ,nav,antenna_distance_m,oscillator,platform",
        "harbour,a/bow.bin; a/stern.bin,brdc.22n,61.5,,",
        "",
        ',"mast, north.obs.gz;b.obs",,,ocxo,',
        ",,,,,p/ferry.toml",
        encoding="utf-8-sig",
    )
    pair = ("a/bow.bin", "a/stern.bin")
    assert read_catalogue(path) == [
        CatalogueItem(name="harbour", inputs=pair, nav="brdc.22n", settings={"antenna_distance_m": 61.5}),
        CatalogueItem(name="mast__north+b", inputs=("mast, north.obs.gz", "b.obs"), settings={"oscillator": "ocxo"}),
        CatalogueItem(name="ferry", inputs=(), platform="p/ferry.toml", settings={}),
    ]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_are_parted_by_what_the_first_line_shows(tmp_path: Path, delimiter: str) -> None:
    rows = (["name", "inputs", "nav"], ["pair", '"a.obs;b.obs"', "n.rnx"], ["mast", "c.obs", ""])
    path = write_catalogue(tmp_path, *(delimiter.join(row) for row in rows))
    assert read_catalogue(path) == [
        CatalogueItem(name="pair", inputs=("a.obs", "b.obs"), nav="n.rnx", settings={}),
        CatalogueItem(name="mast", inputs=("c.obs",), settings={}),
    ]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["name,input", "a,b"], r"line 1: .*'input' .*'inputs'"),
        (["name,nav", "a,b"], r"line 1: .*inputs, .*platform"),
        (["inputs,nav,nav", "a,b,c"], r"line 1: .*'nav' .*twice"),
        (["inputs,place_deg", "a,1"], r"line 1: .*'place_deg'"),
        (["inputs,nav", "a,b", "c,d,e"], r"line 3: 3 .* 2 columns"),
        (["inputs,nav", "a,b", ",d"], "line 3: inputs "),
        (["inputs", "d/a.bin", "", "A.obs"], r"line 4: name = 'A' .*\bline 2;"),
        (["name,inputs", "../a,b"], r"line 2: name = '\.\./a'"),
        (["inputs,window_s", "a,ten"], "line 2: window_s = 'ten'"),
        (["inputs"], "no item"),
        (['inputs', '"a'], r"line 2: .*\bend\b.*CSV"),
        (["name;inputs", "a;b.obs;c.obs"], r'line 2: 3 .* 2 columns; .*";"'),
        (["inputs;window_s", "a;9,5"], r"line 2: window_s = '9,5', .*\bpoint$"),
    ],
)  # fmt: skip
def test_faults_of_a_catalogue_name_file_line_and_remedy(tmp_path: Path, lines: list[str], words: str) -> None:
    with pytest.raises(InputError) as raised:
        read_catalogue(write_catalogue(tmp_path, *lines))
    assert re.search(re.escape(f"{tmp_path / 'catalogue.csv'}: ") + words, str(raised.value))


def test_a_setting_that_makes_no_sense_is_named_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"catalogue\.csv: line 3: .*\bwindow_s = 1\.0, .*\b2\b"):
        read_catalogue(write_catalogue(tmp_path, "inputs,window_s", "a,", "b,1"))


def test_a_result_depends_on_what_its_item_reads(tmp_path: Path) -> None:
    for name in ("a.bin", "a.toml", "n.rnx", "imu.csv"):
        (tmp_path / name).write_text("x")
    (tmp_path / "p.toml").write_text('[imu]\nfile = "imu.csv"\n')
    item = CatalogueItem(name="a", inputs=("a.bin",), nav="n.rnx", platform="p.toml", settings={})
    before = make_piece(item, tmp_path).same_as
    assert make_piece(item, tmp_path).same_as == before
    assert make_piece(dataclasses.replace(item, settings={"window_s": 9.0}), tmp_path).same_as != before
    for name in ("a.bin", "a.toml", "n.rnx", "p.toml", "imu.csv"):
        stat = (tmp_path / name).stat()
        os.utime(tmp_path / name, ns=(stat.st_atime_ns, stat.st_mtime_ns + 1000))
        after = make_piece(item, tmp_path).same_as
        assert after != before, name
        before = after


def read_rows(folder: Path) -> list[FleetRow]:
    done, bad, open_ = (
        CatalogueItem(name=name, inputs=("a.obs", "b.obs"), nav="n.rnx", settings={}) for name in ("<done>", "bad", "x")
    )
    (folder / "done").mkdir()
    shutil.copy(SAMPLE, folder / "done" / "verdict.json")
    return [
        make_row(done, folder / "done", None),
        make_row(bad, folder / "bad", "a.obs: absent & more"),
        make_row(open_, folder / "x", None),
    ]


def test_an_item_is_one_row_of_the_table(tmp_path: Path) -> None:
    found = read_rows(tmp_path)
    write_rows(found, tmp_path / "fleet.parquet")
    table = pq.read_table(tmp_path / "fleet.parquet").to_pylist()
    assert [row["state"] for row in table] == ["done", "failed", "not run"]
    assert [row["verdict"] for row in table] == [found[0].verdict, None, None]
    shares = [table[0][f"share_{label}"] for label in ("authentic", "spoofed", "multipath", "unknown")]
    assert sum(shares) == pytest.approx(1.0)
    assert table[0]["position_lat_deg"] == found[0].position_lat_deg is not None
    assert table[1]["error"] == "a.obs: absent & more"
    assert (table[0]["position_kind"], table[0]["position_hidden_m"]) == ("trusted", 0.0)
    assert table[1]["position_lat_deg"] is None
    assert "seconds" not in table[0]


def test_a_table_has_the_same_columns_whatever_came_out(tmp_path: Path) -> None:
    found = read_rows(tmp_path)
    write_rows(found, tmp_path / "all.parquet")
    write_rows(found[2:], tmp_path / "none.parquet")
    assert pq.read_schema(tmp_path / "all.parquet") == pq.read_schema(tmp_path / "none.parquet")


def test_the_page_lists_every_item_and_loads_nothing(tmp_path: Path) -> None:
    page = write_fleet_html(read_rows(tmp_path))
    assert 'href="items/%3Cdone%3E/report.html">&lt;done&gt;</a>' in page
    assert "a.obs: absent &amp; more" in page
    assert page.index("1 failed") < page.index("1 not run") < page.index("same command")
    assert "http" not in page.replace("http-equiv", "")


def test_the_page_puts_first_what_needs_a_look(tmp_path: Path) -> None:
    done = read_rows(tmp_path)[0]
    found = [dataclasses.replace(done, name=word, verdict=word) for word in ("authentic", "no_attack_seen", "suspect")]
    page = write_fleet_html(found)
    assert page.index("<h2>1 suspect") < page.index("<h2>1 no ") < page.index("<h2>1 authentic")
    assert page.count("Since, GPS time") == 1  # of what is suspect


def keep_one_satellite(path: Path) -> None:
    """Remove all but the first satellite of each epoch from an observation file."""
    lines = path.read_text(encoding="ascii").splitlines()
    kept, after = [], 99
    for line in lines:
        after = 0 if line.startswith(">") else after + 1
        if after == 0:
            line = f"{line[:32]}  1{line[35:]}"
        if not 1 < after < 99:
            kept.append(line)
    path.write_text("\n".join(kept) + "\n", encoding="ascii")


def test_an_item_that_no_test_can_run_on_has_failed(tmp_path: Path) -> None:
    made = simulate("clean", out=tmp_path / "in", duration_s=12.0, depth="measurements").observations
    keep_one_satellite(made[0])
    path = write_catalogue(tmp_path, "name,inputs,nav", f"few,in/{made[0].name},in/broadcast.rnx")
    result = fleet(path, out=tmp_path / "out", workers=1)
    assert result.counts == {"failed": 1}
    assert "no test" in (result.rows[0].error or "")


def test_a_cluster_without_ray_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.delitem(sys.modules, "skyproof.batch.ray_nodes", raising=False)
    with pytest.raises(SettingsError, match=r"skyproof\[ray\]"):
        fleet(write_catalogue(tmp_path, "inputs", "a"), out=tmp_path / "out", ray="auto")


@pytest.mark.parametrize(("workers", "ray", "words"), [(0, None, "workers is 0"), (1, "auto", "both given")])
def test_workers_that_make_no_sense_are_refused(tmp_path: Path, workers: int, ray: str | None, words: str) -> None:
    with pytest.raises(SkyproofError, match=words):
        fleet(write_catalogue(tmp_path, "inputs", "a"), out=tmp_path / "out", workers=workers, ray=ray)
    assert not (tmp_path / "out").exists()


def run_bad_fleet(folder: Path, out: Path, *lines: str, **options: bool) -> FleetResult:
    """Run a fleet whose inputs do not exist."""
    return fleet(write_catalogue(folder, "name,inputs", *lines), out=out, workers=1, **options)


@pytest.mark.parametrize("name", ["fleet.html", "items"])
@pytest.mark.parametrize("overwrite", [False, True])
def test_what_is_of_no_fleet_is_not_overwritten(tmp_path: Path, name: str, overwrite: bool) -> None:
    out = tmp_path / "out"
    (out / "items").mkdir(parents=True) if name == "items" else (out.mkdir(), (out / name).write_text("mine"))
    with pytest.raises(OutputError, match=rf"\b{re.escape(name)} .*\boverwritten"):
        run_bad_fleet(tmp_path, out, "a,a.obs", overwrite=overwrite)
    assert [path.name for path in out.iterdir()] == [name]


def test_results_of_other_files_are_replaced_only_if_asked_to(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run_bad_fleet(tmp_path, out, "a,a.obs").counts == {"failed": 1}
    assert run_bad_fleet(tmp_path, out, "a,a.obs").counts == {"failed": 1}  # goes on
    for done in ((out / "items" / "a" / "verdict.json"), (out / ".skyproof-batch" / "done" / "a")):
        done.parent.mkdir(exist_ok=True)
        done.write_text("foreign")
    with pytest.raises(OutputError, match=r": a; .*--overwrite"):
        run_bad_fleet(tmp_path, out, "a,a.obs")
    assert (out / "items" / "a" / "verdict.json").read_text() == "foreign"
    assert run_bad_fleet(tmp_path, out, "a,a.obs", overwrite=True).counts == {"failed": 1}
    assert not (out / "items" / "a").exists()


def test_a_fleet_that_is_refused_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skyproof.batch.Processes.__enter__", lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run_bad_fleet(tmp_path, tmp_path / "out", "a,a.obs")
    assert [path.name for path in tmp_path.iterdir()] == ["catalogue.csv"]


# Whole fleets


def write_small_fleet(folder: Path, pairs: int) -> Path:
    """Write pairs of receivers as RINEX, and one line whose input does not exist."""
    lines = ["name,inputs,nav,antenna_separation_m", "absent,absent.obs,,"]
    for number in range(pairs):
        made = simulate(
            "two-antennas", out=folder / str(number), seed=number, duration_s=25.0, depth="measurements"
        ).observations
        inputs = ";".join(f"{number}/{path.name}" for path in made if not path.stem.endswith("-2"))
        lines.append(f"pair-{number},{inputs},{number}/broadcast.rnx,10")
    return write_catalogue(folder, *lines)


def read_contents(out: Path) -> dict[str, bytes]:
    """Read every byte that counts."""
    files = [path for path in out.rglob("*") if path.is_file()]
    return {
        path.relative_to(out).as_posix(): path.read_bytes() for path in files if ".skyproof-batch" not in path.parts
    }


@pytest.mark.long
def test_a_fleet_gives_the_same_bytes_for_any_workers_and_kills(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_small_fleet(tmp_path / "in", 8)
    single = fleet(path, out=tmp_path / "one", workers=1)
    assert single.counts["failed"] == 1
    assert sum(single.counts.values()) == 9
    assert "absent.obs" in (single.rows[0].error or "")
    expected = read_contents(tmp_path / "one")
    assert sum(name.endswith("report.html") for name in expected) == 8

    monkeypatch.chdir(tmp_path)  # and named from elsewhere
    call = "import sys; from skyproof.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", call, "fleet", "in/catalogue.csv", "--out", "killed", "--workers", "2"]
    begin = time.monotonic()
    fleet(path, out=tmp_path / "two", workers=2)
    whole_s = time.monotonic() - begin
    assert read_contents(tmp_path / "two") == expected

    moments, killed, completed = random.Random(1), 0, 0
    while killed < 20 or not completed:
        run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            assert run.wait(moments.uniform(0.3, 1.0) * whole_s) == 2  # for the one that is absent
        except subprocess.TimeoutExpired:
            run.kill()
            run.wait()
            killed += 1
        else:
            assert read_contents(tmp_path / "killed") == expected
            shutil.rmtree(tmp_path / "killed")
            completed += 1
