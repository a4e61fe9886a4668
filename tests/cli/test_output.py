"""What commands print: a summary for a person, or one document for --json."""

import json
import re
from pathlib import Path

import pytest
from tests.cli.use_cases import FLEET, PROTECT, VERDICT, App, state_word

from skyproof import cli
from skyproof.cli import demo as demo_command
from skyproof.formats.verdict import write_verdict_json
from skyproof.report.what_now import Advice, what_now
from skyproof.simulator.scenes import load_ready_made, read_ready_made
from skyproof.verdict import Verdict


@pytest.mark.parametrize("command", [PROTECT, ["demo"]])
def test_json_is_one_document_and_nothing_else(
    app: App, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    cli.main([*command, "--json"])
    out, err = capsys.readouterr()
    assert out == write_verdict_json(VERDICT)
    assert re.search(rf"skyproof: doing {command[0]}\nskyproof: .* \[red\]\n", err)


def test_the_summary_is_understood_in_ten_seconds(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(PROTECT)
    out = capsys.readouterr().out
    lines = [re.sub(" +", " ", line).strip() for line in out.splitlines()]
    assert lines[0] == "SPOOFED"
    assert len(lines) < 31
    for line in (
        "Since 2022-01-01 10:00:24 GPS time (10:00:06 UTC) ± 0.5 s",
        "rx1 trusted 59.4121000 16.8837000 31.0 0.8/1.1/2.3 0 10:00:59 10:00:41",
        "rx1 false 59.4064892 16.8951443 43.1 0.8/1.1/2.3 10:00:59 10:00:41",
        "rx1 1 authentic G05",
        "rx1 1 spoofed G05",
        "rx2 1 unknown G07",
        "Tests that could not run: ins_array (the report says why)",
        "report: result/report.html",
    ):
        assert line in lines, line


def test_what_is_not_decided_is_said(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.verdict = state_word("spoofed")
    cli.main(PROTECT)
    out = capsys.readouterr().out
    assert f"Not decided: {app.verdict.reason}\n" in out
    assert f"{Advice.SETTLE}: {app.verdict.remedy}\n" in out


@pytest.mark.parametrize(("word", "first"), [("suspect", "SUSPECT"), ("no_attack_seen", "NO ATTACK SEEN")])
def test_the_word_stands_first(app: App, capsys: pytest.CaptureFixture[str], word: str, first: str) -> None:
    app.verdict = state_word(word)
    cli.main(PROTECT)
    out = capsys.readouterr().out
    lines = out.splitlines()
    assert lines[0] == first
    advice = [out.index(f"\n{kind}: ") for kind, _ in what_now(app.verdict)]
    assert advice == sorted(advice)
    assert advice[-1] < out.index(app.verdict.summary[:20])
    assert out.count(app.verdict.remedy or "none") == 1
    assert ("\nNot excluded: " in out) == (word == "no_attack_seen")


def test_a_long_path_stays_on_one_line(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    folder = "/".join(["a-folder"] * 30)
    cli.main(["protect", "rx1.bin", "--out", folder])
    assert f"report: {folder}/report.html\n" in capsys.readouterr().out


def test_receive_says_what_was_received(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["receive", "rx1.bin", "--out", "d"]) == 0
    assert capsys.readouterr().out.splitlines() == ["rx1: 12 signals", "  a [dim] remark", "files in d"]


def test_receive_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["receive", "rx1.bin", "--out", "d", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["format"], document["folder"], document["interrupted"]) == ("skyproof-receive/1", "d", False)
    (receiver,) = document["receivers"]
    assert (receiver["n_signals"], receiver["remarks"], receiver["files"]) == (12, ["a [dim] remark"], ["rx1-nav.rnx"])


def test_simulate_says_what_was_made_and_how_to_make_it_again(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["simulate", "takeover", "--out", "d"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "takeover"
    assert read_ready_made("takeover").description.startswith(lines[1].strip())
    assert [line for line in lines if line.startswith("recording:")] == [f"recording: d/rx{k}.bin" for k in range(1, 9)]
    assert lines[-4:-1] == ["  and 2 more", "observations: d/rx1.obs", "truth: d/truth.json"]
    assert lines[-1].endswith(": skyproof simulate --out FOLDER d/scenario.toml")


def test_simulate_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.interrupted = True
    assert cli.main(["simulate", "takeover", "--out", "d", "--json"]) == 130
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert (document["format"], document["folder"], document["interrupted"]) == ("skyproof-simulate/1", "d", True)
    assert document["files"] == ["rx1.bin", "truth.json"]
    assert "interrupted: 2 files in d " in err


def test_the_ready_made_scenes_are_listed_with_a_sentence_each(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["simulate", "--list"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert all(name in out for name in load_ready_made())
    assert " ".join(read_ready_made("multipath").description.split())[:30] in out
    assert cli.main(["simulate", "--list", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["scenes"]) == len(load_ready_made())
    assert not app.calls


def test_fleet_counts_its_items_and_names_the_first_that_failed(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.rows = FLEET
    assert cli.main(["fleet", "c.csv", "--out", "d"]) == 2
    out, err = capsys.readouterr()
    assert [line.split() for line in out.splitlines()[1:]] == [
        ["12", "failed"],
        ["2", "spoofed"],
        ["page:", "d/fleet.html"],
    ]
    lines = err.splitlines()
    assert lines[:10] == [f"skyproof: x{n}: x: absent" for n in range(10)]
    assert re.search(r"\b2 more\b.* d/fleet\.html\b", lines[10])
    assert re.match(rf"skyproof: 12 of 14 items .*\({', '.join(f'x{n}' for n in range(10))}, \.\.\.\)", lines[11])
    assert len(lines) == 12


def test_a_fleet_of_which_nothing_failed_exits_with_0(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["fleet", "c.csv", "--out", "d"]) == 0
    assert capsys.readouterr().err == ""


def test_the_verdict_is_printed_when_files_are_missing(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.missing = "result lacks report.html"
    for more in ([], ["--json"], ["--exit-code"]):
        assert cli.main([*PROTECT, *more]) == 2
        out, err = capsys.readouterr()
        assert "spoofed" in out.lower()
        assert err.splitlines()[-1].endswith(" report.html")
    assert cli.main(["receive", "rx1.bin", "--out", "d"]) == 2
    assert "12 signals" in capsys.readouterr().out


def test_fleet_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.interrupted, app.rows = True, FLEET
    assert cli.main(["fleet", "c.csv", "--out", "d", "--json"]) == 130
    out, err = capsys.readouterr()
    items = json.loads(out)["items"]
    assert (len(items), items[0]["verdict"], items[-1]["error"]) == (14, "spoofed", "x: absent")
    assert err.splitlines()[-1].startswith("skyproof: interrupted: ")


def open_skies() -> Verdict:
    """Make one receiver with two skies when the evidence does not decide which is true."""
    sample = VERDICT.model_dump(mode="json")
    receiver = sample["receivers"][0] | {"trusted_fix": None, "false_fix": None, "unprotected_fix": None}
    [source], signal = sample["sources"], sample["signals"][0] | {"label": "unknown", "receiver": "rx1", "because": []}
    places = {
        "S1": {"lat_deg": 59.41, "lon_deg": 16.88, "height_m": 31.0},
        "S2": {"lat_deg": 58.25, "lon_deg": 15.5, "height_m": -4.0},
    }
    return Verdict.model_validate(
        sample
        | {
            "receivers": [receiver],
            "reason": "which is true",
            "sources": [source | {"name": name, "shows": place} for name, place in places.items()],
            "signals": [signal | {"source": name, "copy": copy} for name, copy in zip(places, "ab", strict=True)],
        }
    )


def test_both_places_are_shown_while_the_true_sky_is_open(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.verdict = open_skies()
    cli.main(PROTECT)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["rx1", "S1", "59.4100000", "16.8800000", "31.0", "10:00:59", "10:00:41"] in rows
    assert ["rx1", "S2", "58.2500000", "15.5000000", "-4.0", "10:00:59", "10:00:41"] in rows
    result = app.verdict._repr_html_()
    assert "59.4100000" in result
    assert "58.2500000" in result


def test_demo_opens_the_report_when_asked_to(app: App, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    opened: list[str] = []
    monkeypatch.setattr(demo_command.webbrowser, "open", opened.append)
    cli.main(["demo", "--out", str(tmp_path)])
    assert opened == []
    cli.main(["demo", "--out", str(tmp_path), "--open"])
    assert opened == [(tmp_path / "report.html").as_uri()]


def test_places_are_in_degrees_and_minutes_on_request(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    settings = VERDICT.settings | {"position_format": "degrees-minutes"}
    app.verdict = VERDICT.model_copy(update={"settings": settings})
    cli.main(PROTECT)
    out = capsys.readouterr().out
    assert "59° 24.72600′ N" in out
    assert "59.4121" not in out


def test_what_is_cut_or_left_out_of_inputs_stands_under_the_word(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    (first, *rest) = VERDICT.inputs
    changes = {"cut": ("it ends early",), "left_out": tuple(f"line {k} is left out" for k in range(15))}
    app.verdict = VERDICT.model_copy(update={"inputs": (first.model_copy(update=changes), *rest)})
    cli.main(PROTECT)
    out = " ".join(capsys.readouterr().out.split())
    assert f"Cut: {first.path}: " in out
    assert out.count("left out") == 10
    assert "and 5 more" in out


def test_no_number_of_a_wide_table_is_cut(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    settings = VERDICT.settings | {"position_format": "degrees-minutes"}
    for verdict in (VERDICT, VERDICT.model_copy(update={"settings": settings})):
        app.verdict = verdict
        cli.main(PROTECT)
        out = capsys.readouterr().out
        assert "…" not in out
