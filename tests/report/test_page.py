"""The page: everything is there, nothing is loaded, nothing gets in unescaped, and it is the same every time."""

import copy
import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import pytest
from tests.report.sample import EMPTY, SAMPLE, VERDICT, make_pictures

from skyproof.gnss.time import format_clock
from skyproof.report import evidence
from skyproof.report.evidence import describe_chance
from skyproof.report.figures import Pictures
from skyproof.report.page import write_report_html
from skyproof.report.pictures import (
    DelayProfile,
    DelayTag,
    FixTrack,
    MethodWords,
    RangeDifference,
    SignalSeries,
    SkyPosition,
    TruePlace,
)
from skyproof.report.summary import describe_certainty
from skyproof.report.what_now import Advice
from skyproof.report.words import p_value_words
from skyproof.verdict import CAUSES, Verdict


class Reader(HTMLParser):
    """Collects tags, attributes and text, and checks that every tag is closed where it should be."""

    VOID = frozenset({"meta", "br"})
    SHAPES = frozenset({"path", "line", "circle", "rect"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in self.VOID | self.SHAPES:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.SHAPES:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.text += data


def read(page: str) -> Reader:
    reader = Reader(page)
    reader.text = re.sub(r"[ \n]+", " ", reader.text)
    return reader


def test_the_page_says_everything_that_the_verdict_says() -> None:
    text = read(write_report_html(VERDICT, make_pictures())).text
    for reported in (
        VERDICT.summary,
        "Spoofed since 10:00:24 ± 0.5 s (one sigma), 2022-01-01, GPS time",
        "59.4121000",
        "16.8951443",
        "rx1.bin",
        SAMPLE["inputs"][0]["sha256"],
        "I/Q imbalance 0.3 dB",
        "multi_receiver",
        "Receivers compared",
        "66 tests made",
        "812",
        "13.8",
        VERDICT.methods[1].would_need,
        "p\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}1.3·10⁻⁹",
        "no evidence",
        "antenna_separation_m = 5.0",
        "loops.dll_hz = 1.0",
        "duration_s = null",
        "numpy 2.4.6",
        "4.46 µs behind",
        "skyproof-verdict/2",
        "once in 1\u202f000 hours",
        "1 authentic, 1 spoofed, 1 unknown.",
        "one antenna.",
        "of rx1 lies",
        "the truth",
    ):
        assert reported in text, reported


def test_the_page_draws_what_it_was_given() -> None:
    page = write_report_html(VERDICT, make_pictures())
    headings = [re.search("<h3>(.*?)</h3>", figure) for figure in page.split("<figure")[1:]]
    first, second = ["rx1"], ["rx2"]
    subjects = [re.findall(r"\brx\d", heading[1]) for heading in headings if heading]
    assert subjects == [
        [],
        first,
        second,
        first,
        first,
        first,
        first,
        second,
        first,
        second + first,
        first,
        first + second,
    ]


def test_the_same_input_gives_the_same_bytes() -> None:
    assert write_report_html(VERDICT, make_pictures()) == write_report_html(copy.deepcopy(VERDICT), make_pictures())


def test_the_page_loads_nothing_and_runs_nothing() -> None:
    page = write_report_html(VERDICT, make_pictures())
    reader = read(page)
    assert not {"script", "link", "img", "iframe", "object", "embed", "image", "use", "base", "form"} & set(reader.tags)
    names = {name for name, _ in reader.attributes}
    assert not {name for name in names if name in ("src", "href", "xlink:href", "style") or name.startswith("on")}
    assert not re.search(r"https?:|url\(|@import|//", page.replace("tcp://receiver:2101", ""))  # an input's name
    assert "default-src 'none'" in page


def test_what_comes_from_outside_is_escaped_everywhere() -> None:
    evil = "</style><script>alert('x')</script>\"<b>&"

    def poison(value: Any) -> Any:
        fixed = ("format", "verdict", "label", "gpst", "frame", "state", "subject", "word")
        if isinstance(value, dict):
            return {
                key: item
                if key == "signs"
                or (key == "kind" and item == "position_jump")
                or (any(word in key for word in fixed) and isinstance(item, str))
                else poison(item)
                for key, item in value.items()
            }
        if isinstance(value, list):
            return [poison(item) for item in value]
        return evil if isinstance(value, str) else value

    document = poison(SAMPLE) | {
        "reason": evil,
        "not_excluded": [evil],
        "remedy": evil,
        "settings": {evil: evil, "a": {evil: [evil]}},
        "versions": {evil: evil},
    }
    result = make_pictures(1, 1)
    poisoned = Pictures(
        zero_gpst=result.zero_gpst,
        origin=result.origin,
        onset_s=1.0,
        series=tuple(
            SignalSeries(receiver=evil, signal=evil, label=s.label, seconds=s.seconds, cn0_dbhz=s.cn0_dbhz)
            for s in result.series
        ),
        tracks=tuple(FixTrack(receiver=evil, kind=t.kind, east_m=t.east_m, north_m=t.north_m) for t in result.tracks),
        sky=tuple(
            SkyPosition(receiver=evil, signal=evil, label=p.label, azimuth_deg=1.0, elevation_deg=2.0)
            for p in result.sky
        ),
        truth=(TruePlace(receiver=evil, east_m=0.0, north_m=0.0),),
        profiles=tuple(
            DelayProfile(
                receiver=evil,
                sat=evil,
                at_s=0.0,
                delays_chips=p.delays_chips,
                power=p.power,
                tags=(DelayTag(label="spoofed", delay_chips=0.0),),
            )
            for p in result.profiles
        ),
        differences=(RangeDifference(receivers=(evil, evil), sat=evil, label="unknown", metres=3.0),),
        findings=(MethodWords(detector=evil, words=evil, from_gpst=evil, to_gpst=evil),),
    )
    page = write_report_html(Verdict.model_validate(document), poisoned)
    reader = read(page)
    assert "script" not in reader.tags
    assert "b" not in reader.tags
    assert "alert('x')" in reader.text


def test_colours_follow_the_label_in_light_dark_and_print() -> None:
    page = write_report_html(VERDICT, make_pictures())
    assert page.count("--true:") == page.count("--false:") == 3
    assert "@media (prefers-color-scheme: dark)" in page
    assert "@media print" in page
    assert '<header class="verdict spoofed">' in page


def test_many_signals_over_a_long_time_stay_below_a_megabyte() -> None:
    assert len(write_report_html(VERDICT, make_pictures(20, 12, 1200)).encode()) < 1_000_000


def test_a_page_without_pictures_or_signals_says_so() -> None:
    receiver = SAMPLE["receivers"][1]
    document = SAMPLE | {
        "verdict": "no_attack_seen",
        "reason": "one antenna",
        "not_excluded": ["a false sky from the start"],
        "remedy": "a longer recording",
        "since_gpst": None,
        "receivers": [receiver],
        "signals": [],
        "sources": [],
        "methods": [],
    }
    reader = read(write_report_html(Verdict.model_validate(document), EMPTY))
    for reported in (
        "No position",
        "No signals",
        "No test could run",
        *document["not_excluded"],
        f"{Advice.PROVE} {document['remedy']}",
    ):
        assert reported in reader.text
    assert "figure" not in reader.tags
    assert "Since" not in reader.text


@pytest.mark.parametrize(
    ("verdict", "decision"), [("spoofed", "attack"), ("suspect", "failed"), ("authentic", "authentic")]
)
def test_how_sure_names_the_strongest_evidence_for_the_verdict(verdict: str, decision: str) -> None:
    document = copy.deepcopy(SAMPLE)
    other = document["methods"][0]
    methods = [
        other | {"decision": "clean", "p_value": 1e-9},
        other | {"detector": "d2", "decision": decision, "p_value": 1e-3},
        other | {"detector": "d3", "decision": decision, "p_value": 0.4},
    ]
    document |= {"verdict": verdict, "methods": methods, "reason": "a test failed" if verdict == "suspect" else None}
    reported = " ".join(describe_certainty(Verdict.model_validate(document)))
    assert f" d2: {describe_chance(decision, 1e-3)}" in reported


def test_a_test_that_did_not_decide_rejects_no_clean_sky() -> None:
    document = copy.deepcopy(SAMPLE)
    document["methods"] = [document["methods"][0] | {"decision": "undecided", "p_value": 1e-9}]
    text = read(write_report_html(Verdict.model_validate(document), EMPTY)).text
    assert f"({p_value_words(1e-9)})" in text
    assert describe_chance("undecided", 1e-9) not in text


def test_a_failed_test_stands_first_with_its_window() -> None:
    document = copy.deepcopy(SAMPLE)
    passed = document["methods"][0] | {"detector": "sqm", "decision": "authentic"}
    failed = document["methods"][0] | {"decision": "failed", "p_value": 6.6e-236}
    verdict = Verdict.model_validate(document | {"methods": [passed, failed, document["methods"][1]]})
    first, second = evidence.describe_methods(verdict, ())
    assert (first.method.decision, second.method.decision) == ("failed", "authentic")
    assert "6.6·10" in " ".join(first.sentences)
    assert "2022-01-01 10:00:50 to 10:01:00, GPS time" in " ".join(first.sentences)


def test_a_signal_that_changes_its_label_is_one_signal() -> None:
    signals = [SAMPLE["signals"][0], SAMPLE["signals"][0] | {"label": "unknown"}]
    reported = describe_certainty(Verdict.model_validate(SAMPLE | {"signals": signals}))[-1]
    assert re.findall(r"\d \w+", reported) == ["1 signal", "1 authentic", "1 unknown", "1 changed"]


def list_facts(**changes: Any) -> dict[str, str]:
    """List the answers at the top of a page by question."""
    page = write_report_html(Verdict.model_validate(SAMPLE | changes), EMPTY)
    facts = page[page.index('<dl class="facts">') : page.index("</header>")]
    pairs = re.findall(r"<dt>([^<]*)</dt>(.*?)</div>", facts, re.DOTALL)
    return {name: re.sub(r"[ \n]+", " ", re.sub(r"<[^>]*>", "", answer)).strip() for name, answer in pairs}


def test_the_top_answers_since_when_where_and_how_sure() -> None:
    reported = list_facts()
    assert reported["Spoofed since"] == "10:00:24 ± 0.5 s (one sigma), 2022-01-01, GPS time; 2022-01-01 10:00:06 UTC"
    position = "59.41210° N, 16.88370° E rx1, at 10:00:59.9 GPS time (10:00:41.9 UTC), within "
    assert reported["True position"].startswith(position)
    (false,) = (answer for asked, answer in reported.items() if "false signals" in asked)
    assert "rx1 seems" in false
    assert false.endswith(f" {format_clock('2022-01-01T10:00:59.9')}")
    assert "How sure" not in reported


def test_an_attack_from_the_start_is_described_as_such() -> None:
    reported = list_facts(since_gpst="2022-01-01T10:00:00.0", since_sigma_s=None)
    times = r"10:00:00 or before 2022-01-01, GPS time; 2022-01-01 09:59:42 UTC; .+"
    assert re.fullmatch(times, reported["Spoofed since"])


def test_without_true_signals_the_true_position_is_not_known() -> None:
    receivers = [receiver | {"trusted_fix": None} for receiver in SAMPLE["receivers"]]
    assert list_facts(receivers=receivers)["True position"].startswith("Not known")


def test_a_suspicion_says_since_when() -> None:
    suspicion = {"verdict": "suspect", "reason": "it jumps", "since_sigma_s": None}
    reported = list_facts(**suspicion)
    assert re.match(r"10:00:24 or before 2022-01-01,", reported["Suspect since"])
    assert "Spoofed since" not in reported


def test_the_word_is_shown_with_blanks() -> None:
    passed = SAMPLE | {"verdict": "no_attack_seen", "reason": "one antenna", "not_excluded": ["a false sky"]}
    page = write_report_html(Verdict.model_validate(passed), EMPTY)
    assert "</svg>No attack seen</p>" in page
    assert '<header class="verdict no_attack_seen">' in page


def test_an_open_page_gives_the_possible_positions() -> None:
    receivers = [receiver | {"trusted_fix": None, "false_fix": None} for receiver in SAMPLE["receivers"]]
    place = {"lat_deg": 59.0, "lon_deg": 16.0, "height_m": 1.0}
    sources = [SAMPLE["sources"][0] | {"name": name, "shows": place} for name in ("S1", "S2")]
    reported = list_facts(reason="two skies", receivers=receivers, sources=sources)
    (places,) = (answer for asked, answer in reported.items() if asked.startswith("True position:"))
    assert places.count("59.00000° N, 16.00000° E") == 2


def test_skies_that_differ_are_drawn_each() -> None:
    result = make_pictures()
    other = tuple(replace(p, label="unknown") if p.receiver == "rx2" else p for p in result.sky)
    page = write_report_html(VERDICT, replace(result, sky=other))
    assert "<h3>Sky over rx1</h3>" in page
    assert "<h3>Sky over rx2</h3>" in page


def test_what_belongs_to_the_word_stands_apart() -> None:
    document = SAMPLE | {"reason": "which signals of rx1 are true", "remedy": "a second receiver"}
    text = read(write_report_html(Verdict.model_validate(document), EMPTY)).text
    assert f"Not decided: {document['reason']}." in text
    assert f"{Advice.SETTLE} {document['remedy']}" in text
    document |= {"verdict": "suspect", "may_also_be": ["shade", "gain"]}
    text = read(write_report_html(Verdict.model_validate(document), EMPTY)).text
    assert "Not decided:" not in text  # the summary of a suspicion is its reason
    assert f": {CAUSES['shade']}, or {CAUSES['gain']}." in text
    order = [text.index(part) for part in (Advice.RELY_ON_NOTHING, Advice.SETTLE, document["summary"], "May also be:")]
    assert order == sorted(order)  # what to do, what would settle it, then why


def cut_top(page: str) -> str:
    return page[page.index("<header") : page.index("</header>")]


def test_what_is_cut_or_left_out_of_inputs_stands_at_the_top() -> None:
    inputs = [SAMPLE["inputs"][0] | {"cut": ["after 7 s"], "left_out": ["3 epochs"]}]
    page = write_report_html(Verdict.model_validate(SAMPLE | {"inputs": inputs}), EMPTY)
    assert "after 7 s" in cut_top(page)
    assert "3 epochs" in cut_top(page)
    assert "I/Q imbalance" not in cut_top(page)
    assert all(page.count(words) >= 2 for words in ("after 7 s", "3 epochs"))


def test_places_are_in_degrees_and_minutes_on_the_whole_page() -> None:
    settings = SAMPLE["settings"] | {"position_format": "degrees-minutes"}
    page = write_report_html(Verdict.model_validate(SAMPLE | {"settings": settings}), EMPTY)
    assert "59° 24.726′ N" in cut_top(page)
    assert "59° 24.72600′ N" in page
    assert "59.4121" not in page


def test_every_position_stands_with_its_time_by_both_clocks() -> None:
    page = write_report_html(Verdict.model_validate(SAMPLE), EMPTY)
    rows = page[page.index('<table class="positions">') : page.index("</table>")].split("<tr>")[2:]
    assert rows
    assert all("10:00:59.9" in row and "10:00:41.9" in row for row in rows)
    assert "UTC + 18 s" in page
