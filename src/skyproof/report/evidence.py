"""Methods that ran, in words: what each asked, what it found, and how often chance gives as much."""

from dataclasses import dataclass

from markupsafe import Markup

from skyproof.report import methods, proof
from skyproof.report.pictures import MethodWords
from skyproof.report.words import chance_words, evidence_words, number_words, p_value_words, span_words
from skyproof.verdict import Method, Verdict

__all__ = ["Tested", "describe_chance", "describe_methods", "find_strongest", "quote"]

ORDER = ("spoofed", "attack", "failed", "authentic", "multipath", "undecided", "clean")  # of methods, by what they say


@dataclass(frozen=True)
class Tested:
    """A method that ran, as the page shows it."""

    method: Method
    title: str
    about: str
    found: str
    sentences: tuple[str, ...]
    scale: Markup


def describe_methods(verdict: Verdict, findings: tuple[MethodWords, ...]) -> list[Tested]:
    """Describe the methods that ran, those first that say most."""
    return [_describe_method(m, findings) for m in sorted((m for m in verdict.methods if m.ran), key=_weight)]


def _weight(method: Method) -> tuple[int, str]:
    says = method.decision or "clean"
    return ORDER.index(says) if says in ORDER else len(ORDER), method.detector


def find_strongest(verdict: Verdict) -> Method | None:
    """Find the method with the least p-value for the verdict."""
    words = {"spoofed": ("spoofed", "attack"), "authentic": ("authentic",), "suspect": ("failed",)}
    saying = words.get(verdict.verdict, ())
    for_it = [m for m in verdict.methods if m.ran and m.decision in saying and m.p_value is not None]
    return min(for_it, key=lambda method: method.p_value if method.p_value is not None else 1.0, default=None)


def quote(detector: str) -> str:
    """Quote a detector's heading on this page, or its own name."""
    return f"“{methods.title(detector)}”" if methods.about(detector) else detector


def describe_chance(decision: str | None, p_value: float) -> str:
    """State how often chance gives as much, and of what."""
    otherwise = "if the signals were false" if decision == "authentic" else "under a clean sky"
    often = evidence_words(p_value)
    return f"{otherwise}, chance alone would give a result this strong {often} ({p_value_words(p_value)})."


def _describe_method(method: Method, findings: tuple[MethodWords, ...]) -> Tested:
    found = next((f.words for f in findings if f.detector == method.detector), "")
    scale = Markup("")
    if method.p_value is not None:
        title = f"{method.detector}: {p_value_words(method.p_value)}"
        scale = proof.draw_chance_scale(method.p_value, method.false_alarm_probability, title=title)
    return Tested(
        method,
        methods.title(method.detector),
        methods.about(method.detector),
        f"{found[:1].upper()}{found[1:]}." if found else "",
        tuple(_words_of_test(method)),
        scale,
    )


def _words_of_test(method: Method) -> list[str]:
    sentences = []
    if method.p_value is not None:
        words = describe_chance(method.decision, method.p_value)
        if method.decision == "undecided":  # what was tested, one antenna or a clean sky, the evidence says
            words = f"the test did not decide ({p_value_words(method.p_value)})."
        elif method.decision == "clean":
            words = f"a clean sky explains the result ({p_value_words(method.p_value)})."
        sentences.append(words[0].upper() + words[1:])
    if method.from_gpst is not None:
        sentences.append(f"In the window {span_words(method.from_gpst, method.to_gpst)}, GPS time.")
    if method.statistic is not None:
        against = f", threshold {number_words(method.threshold)}" if method.threshold is not None else ""
        sentences.append(f"Statistic {number_words(method.statistic)}{against}.")
    if not method.tests:
        return [*sentences, "No test was made."]
    made = f"{method.tests} {'test' if method.tests == 1 else 'tests'} made"
    if method.false_alarm_probability is not None:
        made += f"; false-alarm limit of each: {chance_words(method.false_alarm_probability)}"
    return [*sentences, f"{made}."]
