"""What whoever relies on these receivers should do now, by what the verdict says."""

from enum import StrEnum

from skyproof.gnss.time import format_clock
from skyproof.report.positions import describe_distance, measure_misleading_m
from skyproof.report.words import seconds_apart, seconds_words
from skyproof.verdict import USABLE, ReceiverResult, Verdict

__all__ = ["LATE_S", "Advice", "has_lost_fix", "what_now"]

LATE_S = 3.0  # between a receiver's last fix that may be used and its last of all, from which on it is said
OTHER_MEANS = "navigate by other means (inertia, radar, landmarks, a local clock)"


class Advice(StrEnum):
    """What to do, as the page prints it."""

    NOTHING = "Nothing"
    GO_ON = "Keep using the receiver, with care"
    RELY_ON_NOTHING = "Stop using satellite position and time"
    SETTLE = "To settle it"
    PROVE = "To prove it"
    USE_TRUSTED = "Use the trusted position"
    USE_OTHERS = "Use the position of the other signals, with care"
    USE_CARRIED = "Use the position held without satellites"
    USE_NOTHING = "Use no position or time from satellites"
    DO_NOT_WAIT = "Do not wait"
    IGNORE_OTHERS = "Ignore what ordinary receivers show"


def what_now(verdict: Verdict) -> tuple[tuple[Advice, str], ...]:
    """Lines of (what to do, why or with what), the most urgent first."""
    if verdict.verdict == "authentic":
        return ((Advice.NOTHING, "use position and time as usual; this holds while the assumptions below hold"),)
    remedy = () if verdict.remedy is None else (verdict.remedy,)
    lasting = {
        kind: [r for r in verdict.receivers if r.usable and r.usable[0] == kind and not has_lost_fix(r)]
        for kind in USABLE
    }
    if verdict.verdict == "no_attack_seen":
        files = " and ".join(f"{r.name}-consistent.nmea" for r in lasting["consistent"])
        use = f"; the position below is consistent but not proven (track in {files})" if files else ""
        go_on = (Advice.GO_ON, f"nothing points to spoofing, but the attacks under “Not excluded” would pass{use}")
        return (go_on, *((Advice.PROVE, words) for words in remedy))
    carried = [*lasting["inertial"], *lasting["held"]]
    lines = [(Advice.USE_CARRIED, "below, which signals cannot move; its track is in fixes.csv")] if carried else []
    if verdict.verdict == "suspect":
        stop = (Advice.RELY_ON_NOTHING, f"{OTHER_MEANS} until this is settled")
        return (*lines, stop, *((Advice.SETTLE, words) for words in remedy))
    if lasting["trusted"]:
        files = " and ".join(f"{r.name}-trusted.nmea" for r in lasting["trusted"])
        lines.insert(0, (Advice.USE_TRUSTED, f"below; its track is in {files}"))
    if of_rest := [r for r in lasting["consistent"] if _is_under_attack(r, verdict)]:
        files = " and ".join(f"{r.name}-consistent.nmea" for r in of_rest)
        lines.append((Advice.USE_OTHERS, f"below: no test rejects it, and none proves it; its track is in {files}"))
    if not lines:
        since = f" since {format_clock(verdict.since_gpst)}" if verdict.since_gpst is not None else ""
        lines.append((Advice.USE_NOTHING, f"{OTHER_MEANS}; the attack is on{since}"))
    usable = [r for r in verdict.receivers if r.usable is not None]
    settle = [(Advice.SETTLE, words) for words in remedy]
    return (*lines, *([_warn_of_others(usable, verdict)] if usable else []), *settle)


def _is_under_attack(receiver: ReceiverResult, verdict: Verdict) -> bool:
    """Whether a receiver's last usable fix is later than when the attack was seen, and than the word."""
    if receiver.usable is None or verdict.since_latest_gpst is None:
        return False
    gpst = receiver.usable[1].gpst
    return gpst > verdict.since_latest_gpst and any(w.word == "spoofed" and w.from_gpst < gpst for w in verdict.windows)


def has_lost_fix(receiver: ReceiverResult) -> bool:
    """Whether a receiver has later fixes than its last one that may be used."""
    if receiver.usable is None:
        return False
    fix, others = receiver.usable[1], (receiver.false_fix, receiver.unprotected_fix)
    return any(o is not None and seconds_apart(o.gpst, fix.gpst) > LATE_S for o in others)


def _warn_of_others(usable: list[ReceiverResult], verdict: Verdict) -> tuple[Advice, str]:
    """Whether an ordinary receiver is led away: by the one that is led farthest."""
    r = max(usable, key=measure_misleading_m)
    if not measure_misleading_m(r) or r.unprotected_fix is None:
        return Advice.DO_NOT_WAIT, "the unprotected position is still right; it can change at any time"
    words = f"without protection {r.name} is off by {describe_distance(r, r.unprotected_fix)}"
    offsets_s = [source.time_offset_s for source in verdict.sources if source.time_offset_s]
    if len(offsets_s) == 1:
        words += f"; the false time is {seconds_words(abs(offsets_s[0]))} {'behind' if offsets_s[0] > 0.0 else 'ahead'}"
    return Advice.IGNORE_OTHERS, words
