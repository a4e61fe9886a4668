"""The words so far come while recordings are being tracked, and nothing of them is in the result."""

from contextlib import contextmanager

import pytest
from tests.app import kit

from skyproof.app.protect import preview, protect
from skyproof.app.protect.preview import Preview
from skyproof.app.protect.so_far import NOTES


class Listener:
    """Progress that notes what it hears, in order."""

    def __init__(self):
        self.heard = []

    def say(self, text):
        self.heard.append(text)

    def advance(self, to):
        pass

    @contextmanager
    def stage(self, name, total):
        self.heard.append(name)
        yield self


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    return kit.record(kit.make_scenario(receivers=1, duration_s=20.0), tmp_path_factory.mktemp("preview"))


@pytest.fixture
def slow(monkeypatch):
    """Let every run count as one that will still track for long."""
    monkeypatch.setattr(preview, "_SOON_S", 0.0)


@pytest.mark.usefixtures("slow")
def test_the_first_word_comes_before_all_is_tracked(recordings, tmp_path):
    listener = Listener()
    result = protect(recordings.paths, nav=recordings.nav, window_s=5.0, out=tmp_path / "out", progress=listener)
    examining = next(n for n, text in enumerate(listener.heard) if text.startswith("examining"))
    words = [n for n, text in enumerate(listener.heard) if text.startswith("up to ")]
    assert words[0] < examining
    assert len(words) == len({listener.heard[n].partition(": ")[2] for n in words})  # no word is told twice
    assert result.verdict.verdict == "no_attack_seen"
    assert not [path for name in NOTES for path in (tmp_path / "out").rglob(name)]


def test_a_run_that_ends_soon_is_examined_once(recordings, monkeypatch):
    monkeypatch.setattr(preview, "_SOON_S", 1e3)
    listener = Listener()
    protect(recordings.paths, nav=recordings.nav, window_s=5.0, progress=listener)
    examining = next(n for n, text in enumerate(listener.heard) if text.startswith("examining"))
    assert not [text for text in listener.heard[:examining] if text.startswith("up to ")]


@pytest.mark.usefixtures("slow")
def test_a_look_that_fails_costs_no_run(recordings, monkeypatch):
    def fail(*_):
        looks.append(True)
        raise ValueError("too little yet")

    looks = []
    monkeypatch.setattr(Preview, "_examine", fail)
    assert protect(recordings.paths, nav=recordings.nav, window_s=5.0).verdict.verdict == "no_attack_seen"
    assert looks
