"""`skyproof study`: rows, claims, charts, and the table of all figures."""

import json
import re
from pathlib import Path

import pytest
from tests.cli.use_cases import App

from skyproof import cli


def test_study_prints_its_rows_and_claims(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "multi-receiver.false-alarm", "--trials", "9", "--seed", "4"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == "multi-receiver.false-alarm: What is kept"
    assert "paper 10 0.5" in lines
    printed = " ".join(lines[lines.index("paper 10 0.5") :]).split()
    assert printed.count("0.5") == 3  # of the row, of the paper and of ours
    assert {"not", "reached", "within", "0.1"} <= set(printed)
    assert app.calls == [("study", 9, {"seed": 4, "quick": False})]


def test_study_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    command = ["study", "multi-receiver.false-alarm", "--quick", "--json", "--plot", "--out", str(tmp_path / "new")]
    assert cli.main(command) == 0
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert err == "skyproof: rows of multi-receiver.false-alarm\n"
    assert (document["format"], document["study"]) == ("skyproof-study/1", "multi-receiver.false-alarm")
    assert (document["seed"], document["trials"], document["quick"], document["interrupted"]) == (1, None, True, False)
    assert document["rows"] == [
        {"method": "paper", "window_s": 10, "kept": 0.5},
        {"method": "skyproof", "window_s": 30, "kept": None},
    ]
    assert document["claims"][0]["agrees"] is True
    written = {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "new").iterdir()}
    assert written.keys() == {"multi-receiver.false-alarm.json", "multi-receiver.false-alarm.svg"}
    assert written["multi-receiver.false-alarm.json"] == out
    assert written["multi-receiver.false-alarm.svg"].startswith("<svg ")


def test_a_chart_without_a_folder_is_written_here(
    app: App, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["study", "multi-receiver.false-alarm", "--plot"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["multi-receiver.false-alarm.svg"]
    assert "chart: multi-receiver.false-alarm.svg\n" in capsys.readouterr().out


def test_an_interrupted_study_prints_the_rows_that_were_ready(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.error = KeyboardInterrupt()
    assert cli.main(["study", "multi-receiver.false-alarm", "--json"]) == 130
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert (document["interrupted"], len(document["rows"]), document["claims"]) == (True, 1, [])
    (line,) = err.splitlines()[1:]
    assert re.match(r"skyproof: interrupted .*\b1 row\b", line)


def test_the_studies_are_listed_with_paper_and_figure(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "--list"]) == 0
    out = capsys.readouterr().out
    assert all(words in out for words in ("Someone 2022", "multi-receiver.false-alarm", "Figure 1"))
    assert cli.main(["study", "--list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["studies"]
    assert [item["study"] for item in listed] == ["multi-receiver.false-alarm", "spin.roc"]
    assert not app.calls


def test_the_table_of_all_figures_is_one_file(app: App, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "--validation", str(tmp_path / "validation.md"), "--quick", "--seed", "7"]) == 0
    text = (tmp_path / "validation.md").read_text(encoding="utf-8")
    assert re.search(r"\bseed 7, quick\b", text)
    assert "| kept at 10 s | 0.5 | 0.5 | 0.1 |" in text
    assert [call[0] for call in app.calls] == ["study"]  # the one that claims nothing need not run
    assert "multi-receiver.false-alarm" in capsys.readouterr().err


def test_a_study_without_a_chart_keeps_its_rows_on_plot(
    app: App, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert cli.main(["study", "spin.roc", "--plot", "--json", "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["study"] == "spin.roc"
    assert json.loads((tmp_path / "spin.roc.json").read_text(encoding="utf-8")) == json.loads(out)
    assert "spin.roc has no" in err
    assert not (tmp_path / "spin.roc.svg").exists()


def test_an_interrupted_table_of_all_figures_is_not_written(
    app: App, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    app.error = KeyboardInterrupt()
    assert cli.main(["study", "--validation", str(tmp_path / "validation.md")]) == 130
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1].startswith("skyproof: interrupted: ")
    assert list(tmp_path.iterdir()) == []
