"""The answer: `Verdict`, the document that `protect` gives and `verdict.json` holds.

Immutable models whose fields stand in the order of the document. Every key is always there; what is absent is None
(`null`), never NaN. An instant is text, ISO 8601 without a zone, in GPS time. Angles are degrees: this is an edge.

Building a model checks it (`pydantic.ValidationError`, a ValueError): unknown keys, numbers that are not finite,
probabilities outside 0 to 1, and names that point nowhere are refused.
"""

import math
import warnings
from collections.abc import Iterable
from typing import Annotated, Final, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, JsonValue, model_validator

from skyproof.gnss.time import format_clock, format_instant, format_moment, format_utc
from skyproof.records import WORDS, CauseName, InterferenceSign, Label, NoticedKind, VerdictWord
from skyproof.short_repr import write_notebook_html

__all__ = [
    "USABLE",
    "VERDICT_FORMAT",
    "WORDS",
    "Because",
    "InputFile",
    "InterferenceResult",
    "InterferenceSpell",
    "Label",
    "Method",
    "NoticedSize",
    "NullResult",
    "OwnFix",
    "OwnState",
    "Place",
    "Position",
    "ReceiverResult",
    "Signal",
    "Source",
    "UsableKind",
    "Verdict",
    "VerdictWord",
    "WeakCarrier",
    "WindowResult",
    "list_possible_places",
    "radius_95_m",
    "write_word",
]

VERDICT_FORMAT: Literal["skyproof-verdict/2"] = "skyproof-verdict/2"

CAUSES: Final[dict[CauseName, str]] = {
    "reflections": "reflections",
    "interference": "a jammer or other noise",
    "gain": "a change of gain, or a high-gain antenna",
    "shade": "shading of the antenna",
    "oscillator": "the receiver's oscillator",
    "motion": "motion of the antennas",
    "fault": "a fault of a satellite or of the receiver",
    "orbits": "wrong orbits or clocks",
    "statement": "a setting that does not hold, stated or by default",
    "missing_samples": "missing samples",
    "joined": "a recording joined from several",
}
"""Each cause as people read it."""
UsableKind = Literal["trusted", "consistent", "inertial", "held"]
USABLE: Final[tuple[UsableKind, ...]] = get_args(UsableKind)
"""Positions that a user may use, one an epoch, the first that there is.

trusted : from signals that are shown to be true. consistent : from all signals, but for false ones and reflections,
while no test of them has failed: not proven. inertial : carried on from those by an inertial unit. held : where they
were, of a receiver that is stated to stand.
"""
MOST_NAMED: Final = 10
"""Remarks on inputs that stand beside the word; the others are counted."""

Gpst = Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,9})?$")]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Sigma = Annotated[float, Field(ge=0.0)]
LatDeg = Annotated[float, Field(ge=-90.0, le=90.0, description="Geodetic, WGS-84, degrees, north and east positive.")]
LonDeg = Annotated[float, Field(ge=-180.0, le=180.0, description="Geodetic, WGS-84, degrees, north and east positive.")]
HeightM = Annotated[float, Field(description="Above the ellipsoid, metres.")]


def write_word(word: str) -> str:
    """Write a word of the answer as people read it: no attack seen."""
    return word.replace("_", " ")


def _join_few(texts: Iterable[str]) -> str:
    """Join the first few texts, and how many more there are."""
    named = list(texts)
    more = [f"and {len(named) - MOST_NAMED} more, among the remarks on the inputs"] if len(named) > MOST_NAMED else []
    return "; ".join([*named[:MOST_NAMED], *more])


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Place(_Model):
    """A point on or near the Earth."""

    lat_deg: LatDeg
    lon_deg: LonDeg
    height_m: HeightM


class Position(_Model):
    """A position fix at one instant with its uncertainty."""

    gpst: Gpst = Field(description="Time of the fix, GPS time, ISO 8601 without a zone.")
    lat_deg: LatDeg
    lon_deg: LonDeg
    height_m: HeightM
    sigma_east_m: Sigma = Field(description="Standard deviation in that direction, metres.")
    sigma_north_m: Sigma = Field(description="Standard deviation in that direction, metres.")
    sigma_up_m: Sigma = Field(description="Standard deviation in that direction, metres.")
    horizontal_protection_m: Sigma | None = Field(
        default=None,
        description="Protection level of a usable fix, metres: its horizontal error exceeds it with a "
        "probability of `integrity_risk` at most, whatever one satellite is wrong by; null "
        "where none is promised.",
    )
    vertical_protection_m: Sigma | None = Field(default=None, description="The same vertically, metres.")
    hidden_m: Sigma | None = Field(
        default=None,
        description="Additional error that an attack may have caused without a test noticing, if signals "
        "were true at the start, metres; 0 of a trusted fix, null where nothing bounds it.",
    )


class OwnState(_Model):
    """What a receiver says of itself in its log, for as long as it does. It is never evidence."""

    subject: Literal["jamming", "spoofing", "authentication"]
    state: str = Field(description="The protocol's own word: none, warning, critical, indicated.")
    alarm: bool = Field(description="Whether the word claims jamming, spoofing or a failed authentication.")
    since_gpst: Gpst = Field(description="First instant of the statement, GPS time.")
    until_gpst: Gpst = Field(description="Last instant of the statement, GPS time.")


class OwnFix(_Model):
    """The last position that a receiver computed itself, and how far its positions lie from the trusted ones."""

    gpst: Gpst = Field(description="Time of the fix, GPS time.")
    lat_deg: LatDeg
    lon_deg: LonDeg
    height_m: HeightM
    horizontal_sigma_m: Sigma | None = Field(description="As the receiver states it, metres; null if it does not.")
    from_trusted_m: Sigma | None = Field(
        description="From the trusted fix of the last epoch that both have, horizontally, metres; null without one."
    )
    most_from_trusted_m: Sigma | None = Field(description="The largest of those distances, metres.")
    most_from_trusted_gpst: Gpst | None = Field(description="When that was, GPS time.")


class NullResult(_Model):
    """What an antenna array receives once sources that stand above its noise are taken out of its samples."""

    source_to_noise_db: float = Field(
        description="Power of the sources over the noise of one antenna, dB, median of the time without positions; "
        "what coarse samples make of a source counts as noise."
    )
    word: VerdictWord = Field(description="What one receiver's tests say of the signals behind the null alone.")
    from_gpst: Gpst | None = Field(description="First position found behind the null, GPS time; null without any.")
    to_gpst: Gpst | None = Field(description="Last position found behind the null, GPS time; null without any.")
    seconds: Sigma = Field(description="How long positions are those found behind the null, seconds.")
    cn0_cost_db: float | None = Field(
        description="How much lower C/N0 is behind the null than without a source, dB, median of the signals; null "
        "where no signal shows both."
    )


class ReceiverResult(_Model):
    """One receiver: what it recorded, and the positions that its signals give, each the last one of its kind."""

    name: str = Field(description="Its name in this document.")
    word: VerdictWord | None = Field(
        default=None, description="The worst of its words over time; null if no window could be tested."
    )
    input: str = Field(description="File or stream that the receiver's signals came from.")
    start_gpst: Gpst | None = Field(description="Start of the stretch examined, GPS time; null if no time is known.")
    duration_s: Sigma = Field(description="Length of the stretch examined, seconds.")
    trusted_fix: Position | None = Field(description="From authentic signals only; null without any.")
    consistent_fix: Position | None = Field(
        default=None,
        description="From all signals but false ones and reflections, while no test has failed; not proven. "
        "Null if there is none, or a trusted one at each epoch.",
    )
    inertial_fix: Position | None = Field(
        default=None, description="From the inertial unit, where satellites give neither."
    )
    held_fix: Position | None = Field(
        default=None, description="The last of those, of a receiver stated to stand, where satellites give none."
    )
    behind_null: NullResult | None = Field(
        default=None,
        description="Consistent fixes of an antenna array behind a null, where a source leaves none; they change no "
        "word and no label. Null where no source costs positions.",
    )
    false_fix: Position | None = Field(description="Position by the false signals; null without any.")
    unprotected_fix: Position | None = Field(description="Position of a receiver without protection.")
    own_fix: OwnFix | None = Field(
        default=None, description="The receiver's own fix by its log; null if the log has none."
    )
    own_states: tuple[OwnState, ...] = Field(
        default=(), description="The receiver's own statements on jamming and spoofing; never evidence."
    )

    @property
    def fixes(self) -> tuple[tuple[str, Position], ...]:
        """Return the last fix of each kind that there is, first usable ones, with the kind."""
        kinds = (*USABLE, "false", "unprotected")
        return tuple((kind, fix) for kind in kinds if (fix := getattr(self, f"{kind}_fix")) is not None)

    @property
    def usable(self) -> tuple[UsableKind, Position] | None:
        """Return the last fix that may be used, with its kind; None without any."""
        found = [(kind, fix) for kind, fix in self.fixes if kind in USABLE]
        return max(found, key=lambda each: (each[1].gpst, -USABLE.index(each[0])), default=None)


class WindowResult(_Model):
    """The word of one receiver over consecutive windows that have the same one."""

    receiver: str
    word: VerdictWord
    from_gpst: Gpst = Field(description="Start of the first window, GPS time.")
    to_gpst: Gpst = Field(description="End of the last window, GPS time.")
    may_also_be: tuple[CauseName, ...] = Field(
        description="Of suspect: what else than an attack explains all tests that failed in a window, alone or with "
        "another of them, the likeliest first; empty where nothing failed in these windows themselves."
    )


class Because(_Model):
    """A detector that speaks for a signal's label."""

    detector: str = Field(description="Name of the detector.")
    p_value: Probability | None = Field(
        description="Probability of evidence at least this strong if the label were wrong; null where none is stated."
    )


# The document's key `copy` hides a method of BaseModel that is deprecated for `model_copy`; nothing here misses it.
with warnings.catch_warnings():
    warnings.filterwarnings("ignore", message='Field name "copy"', category=UserWarning)

    class Signal(_Model):
        """One received signal and its label. One satellite may be received as several signals."""

        receiver: str = Field(description="Its receiver.")
        sat: str = Field(description="Satellite that it claims to come from, as RINEX names it: G05.")
        band: str = Field(description="Frequency band and ranging code: L1, CA.")
        code: str = Field(description="Frequency band and ranging code: L1, CA.")
        copy: str = Field(  # type: ignore[assignment]
            description="Tells several signals of one satellite apart, in order of finding; nothing more."
        )
        label: Label = Field(description="What the evidence says of the signal; unknown without evidence.")
        source: str | None = Field(description="Its source; null if none.")
        from_gpst: Gpst | None = Field(description="First and last instant of its reception, GPS time.")
        to_gpst: Gpst | None = Field(description="First and last instant of its reception, GPS time.")
        cn0_dbhz: float | None = Field(description="C/N0, mean over its reception, dB-Hz.")
        doppler_hz: float | None = Field(description="Apparent carrier minus nominal carrier, mean, hertz.")
        delay_to_authentic_m: float | None = Field(
            description="Code delay behind the same satellite's authentic signal, metres; null without one."
        )
        because: tuple[Because, ...] = Field(description="The evidence for the label; empty for unknown.")


class SourceDirection(_Model):
    """One direction from which a source's signals may come."""

    frame: Literal["ground", "body"] = Field(
        description="Reference of the angles: north and horizon, or the body's forward axis and plane."
    )
    azimuth_deg: float = Field(ge=0.0, le=360.0, description="Clockwise from north or from forward, degrees.")
    elevation_deg: float = Field(ge=-90.0, le=90.0, description="Above the horizon or the body's plane, degrees.")
    along_sigma_deg: Sigma = Field(description="Standard deviation along the horizon (or plane) and across, degrees.")
    up_sigma_deg: Sigma = Field(description="Standard deviation along the horizon (or plane) and across, degrees.")
    correlation: float = Field(ge=-1.0, le=1.0, description="Correlation of the two.")


class SourcePlace(Place):
    """Where a source stands: where the directions meet in which it is seen from several places."""

    sigma_up_m: Sigma = Field(description="Standard deviation upwards, metres.")
    ellipse_major_m: Sigma = Field(description="Half axes of the horizontal ellipse of 95 %, metres.")
    ellipse_minor_m: Sigma = Field(description="Half axes of the horizontal ellipse of 95 %, metres.")
    ellipse_azimuth_deg: float = Field(
        ge=0.0, le=180.0, description="Direction of the greater axis, clockwise from north, degrees."
    )


class Source(_Model):
    """Signals of one origin: a transmitter of false ones or, while that is open, one consistent sky of several.

    `kind` says which of the two, in words.
    """

    name: str = Field(description="Name in the signals.")
    kind: str = Field(description="Kind in words: one antenna; a false sky; a sky that may be true.")
    sats: tuple[str, ...] = Field(description="Satellites of its signals.")
    azimuth_deg: float | None = Field(
        ge=0.0,
        le=360.0,
        description="Clockwise from north and above the horizon, degrees; null if unknown or ambiguous.",
    )
    elevation_deg: float | None = Field(
        ge=-90.0,
        le=90.0,
        description="Clockwise from north and above the horizon, degrees; null if unknown or ambiguous.",
    )
    direction_sigma_deg: Sigma | None = Field(description="Standard deviation of the direction, degrees.")
    body_azimuth_deg: float | None = Field(
        default=None,
        ge=0.0,
        le=360.0,
        description="From the body's forward axis and plane, degrees, if the attitude is unknown.",
    )
    body_elevation_deg: float | None = Field(
        default=None,
        ge=-90.0,
        le=90.0,
        description="From the body's forward axis and plane, degrees, if the attitude is unknown.",
    )
    directions: tuple[SourceDirection, ...] = Field(
        default=(),
        description="Every direction that the phases allow; if several, the keys before are null.",
    )
    stands: SourcePlace | None = Field(
        default=None,
        description="Position where its directions from several places meet; their errors may be common.",
    )
    shows: Place | None = Field(description="Position that its signals show.")
    shows_gpst: Gpst | None = Field(default=None, description="Time of that position, the last one, GPS time.")
    time_offset_s: float | None = Field(
        description="Clock bias by these signals minus that by authentic ones (else by the sky that arrives "
        "first), seconds; positive for late signals."
    )


class Method(_Model):
    """One detector: what it found, or why it did not run and what it would need."""

    detector: str = Field(description="Name of the detector.")
    ran: bool = Field(description="Whether it could run on this input.")
    why_not: str | None = Field(description="Why it did not run; null if it ran.")
    would_need: str | None = Field(description="What would let it run or decide; null if nothing.")
    decision: str | None = Field(
        description="The first of spoofed, attack, failed (rejects a clean sky), authentic, multipath, clean, "
        "undecided that any window gives; null if it did not run."
    )
    tests: int = Field(ge=0, description="Number of tests that it made.")
    from_gpst: Gpst | None = Field(description="Window of its most telling test, GPS time.")
    to_gpst: Gpst | None = Field(description="Window of its most telling test, GPS time.")
    statistic: float | None = Field(description="Of that test, in the detector's own unit.")
    threshold: float | None = Field(description="Of that test, in the detector's own unit.")
    p_value: Probability | None = Field(description="p-value of that test: the least of those with that decision.")
    false_alarm_probability: Probability | None = Field(description="False-alarm probability asked of one decision.")

    @model_validator(mode="after")
    def _states_why_it_did_not_run(self) -> Self:
        if not self.ran and not self.why_not:
            raise ValueError(f"{self.detector} did not run, but why_not does not say why")
        return self


class InputFile(_Model):
    """One input as it was read."""

    path: str = Field(description="Path or address as given.")
    format: str = Field(description="Format: raw, RINEX navigation, platform.")
    sha256: str | None = Field(description="SHA-256 of the whole file, hexadecimal; null for a stream.")
    cut: tuple[str, ...] = Field(description="Early end, or change while it was read: the word holds up to there.")
    left_out: tuple[str, ...] = Field(description="Parts not used or doubtful: the word does not cover them.")
    remarks: tuple[str, ...] = Field(description="Other oddities, without effect on the word.")

    @property
    def all_remarks(self) -> tuple[str, ...]:
        """Return whatever was odd about it, the gravest first."""
        return (*self.cut, *self.left_out, *self.remarks)


class DoubtfulStatement(_Model):
    """How a statement of the user may be untrue, which would explain what was found."""

    code: str = Field(description="What kind of thing: height_above_sea_level, feet, wrong_statement and so on.")
    about: str = Field(description="The statement that would be wrong.")
    words: str = Field(description="How, in words.")
    value: str | None = Field(description="What would be right; null if that is not known.")


class InterferenceSpell(_Model):
    """Interference of one receiver without a break: noise that weakens all signals of a carrier alike."""

    receiver: str
    carriers: tuple[str, ...] = Field(description="Carriers that it weakens, by GPS's name where systems share one.")
    since_gpst: Gpst = Field(description="First epoch that shows it, GPS time.")
    until_gpst: Gpst | None = Field(description="Last epoch that shows it, GPS time; null while it lasts.")
    fall_db: Sigma = Field(description="Largest fall of C/N0, dB; a lower bound where most signals are lost.")
    fall_sigma_db: Sigma = Field(description="One sigma of what C/N0 changes by without interference, dB.")
    level_db: float | None = Field(description="Rise of power in the front end, dB; null where it is not known.")
    jammer_to_noise_db: float | None = Field(
        default=None,
        description="Power of the interference over the receiver's noise (J/N) at its strongest, dB; by C/N0 and, "
        "where that is known, the level of the front end. Null if the noise does not rise.",
    )
    jammer_to_noise_low_db: float | None = Field(
        default=None, description="It is more than this in 97.5 %, dB; null where none at all is possible."
    )
    jammer_to_noise_high_db: float | None = Field(
        default=None,
        description="It is less than this in 97.5 %, dB; null where most signals are lost and no level known.",
    )
    lost_signals: int = Field(ge=0, description="Signals that were lost, the most at once.")
    signs: tuple[InterferenceSign, ...] = Field(
        description="What shows it: cn0 (C/N0 falls), lost (most signals are lost), level (more power comes in)."
    )
    may_also_be: tuple[CauseName, ...] = Field(description="What else would do the same: shade, or nothing.")

    @property
    def strength(self) -> str:
        """State the power over the receiver's noise with its limits; empty where it is not known."""
        if self.jammer_to_noise_db is None:
            return ""
        low, high = self.jammer_to_noise_low_db, self.jammer_to_noise_high_db
        if high is None:
            return "J/N at least " + f"{self.jammer_to_noise_db if low is None else low:.0f} dB"
        limits = f"below {high:.0f}" if low is None else f"{low:.0f} to {high:.0f}"
        return f"J/N {self.jammer_to_noise_db:.0f} dB ({limits} in 95 %)"


class WeakCarrier(_Model):
    """Signals weaker from a receiver's first window on than satellites under an open sky are."""

    receiver: str
    carrier: str = Field(description="By GPS's name where systems share one.")
    since_gpst: Gpst = Field(description="First epoch, GPS time.")
    cn0_dbhz: float = Field(description="Median of the satellites' C/N0, dB-Hz.")
    open_sky_dbhz: float = Field(description="Least that an open sky gives a plain antenna, dB-Hz.")

    @property
    def words(self) -> str:
        """State how weak, and that C/N0 alone does not tell why."""
        return (
            f"C/N0 of satellites on {self.carrier} in {self.receiver} is {self.cn0_dbhz:.0f} dB-Hz from the first "
            f"epoch on (open sky: {self.open_sky_dbhz:.0f} or more), by a jammer, shading or a poor antenna; the "
            "front end's level in a quiet hour would tell which"
        )


class InterferenceResult(_Model):
    """Whether noise of others came in. It is no part of the verdict: a jammer shows no false position."""

    state: Literal["none", "present", "not_tested"] = Field(
        description="not_tested: the inputs hold no C/N0 of enough satellites over enough time."
    )
    spells: tuple[InterferenceSpell, ...] = ()
    weak_starts: tuple[WeakCarrier, ...] = Field(
        default=(), description="What may be interference from the first epoch on, or shade, or a poor antenna."
    )

    @model_validator(mode="after")
    def _state_fits(self) -> Self:
        if (self.state == "present") != bool(self.spells):
            raise ValueError(f"interference is {self.state} with {len(self.spells)} spells")
        return self

    @property
    def words(self) -> str:
        """Describe what interfered, since when, how much and with whom; empty where nothing did."""
        found = [_spell_words(spell) for spell in self.spells] + [weak.words for weak in self.weak_starts]
        return "; ".join(found[:MOST_NAMED])


def _spell_words(spell: InterferenceSpell) -> str:
    until = "" if spell.until_gpst is None else f" until {format_clock(spell.until_gpst)}"
    level = "" if spell.level_db is None else f", the power in the front end rises by {spell.level_db:.0f} dB"
    lost = f", {spell.lost_signals} signals are lost" if "lost" in spell.signs else ""
    least = "at least " if "lost" in spell.signs else ""
    shade = "; shading of the whole antenna would look the same" if spell.may_also_be else ""
    strength = f", {spell.strength}" if spell.strength else ""
    return (
        f"since {format_moment(spell.since_gpst)}{until} in {spell.receiver}: C/N0 of all satellites on "
        f"{', '.join(spell.carriers)} falls by {least}{spell.fall_db:.0f} dB{lost}{level}{strength}{shade}"
    )


class NoticedSize(_Model):
    """From which size on an attack on one receiver would have been noticed, with a probability of 0.99.

    It is an attack on all signals of the receiver at once, while they are received without a break, where its kind
    names no number of them.
    """

    receiver: str
    kind: NoticedKind = Field(
        description="position_jump and clock_jump: the position or the time jumps; velocity_jump and clock_push: codes "
        "and carriers begin at once to drag the position off or to push the time; code_drag: codes drag the position "
        "off while carriers stay; motion: carriers move a receiver that is stated to stand; drag: codes "
        "drag the position of a receiver with an inertial unit off, alone or with their carriers; displacement: the "
        "position of a receiver that stands is moved, however slowly; one_transmitter: an antenna imitates so many "
        "satellites; elsewhere: one false signal, which no reflection explains, comes from so far beside its satellite."
    )
    size: Sigma = Field(description="In the window in which the tests see least.")
    unit: str = Field(description="Of the size: m, s, m/s, s/s, rad, or 1 of a number.")
    detector: str = Field(description="Whose test sees it best in that window.")
    share_of_windows: Probability = Field(description="Of the receiver's windows, how many were tested for it.")

    @property
    def words(self) -> str:
        """Describe what would have been noticed."""
        attack, scale, unit = _NOTICED[self.kind]
        where = "" if self.share_of_windows > 0.995 else f" (in {100.0 * self.share_of_windows:.0f} % of the windows)"
        return f"{attack} {float(f'{self.size * scale:.2g}'):g} {unit} or more{where}"


_HOW: Final[dict[UsableKind, str]] = {
    "trusted": "is trusted",
    "consistent": "is consistent, but not proven",
    "inertial": "is dead-reckoned from the inertial unit",
    "held": "is held at its last trusted place",
}
"""What a position comes from, in words."""

_NOTICED: Final[dict[NoticedKind, tuple[str, float, str]]] = {
    "position_jump": ("a jump of the position by", 1.0, "m"),
    "clock_jump": ("a jump of the time by", 1e9, "ns"),
    "velocity_jump": ("a drag of the position that starts abruptly at", 1.0, "m/s"),
    "clock_push": ("a drag of the time that starts abruptly at", 1e9, "ns/s"),
    "code_drag": ("a drag of the position by codes without carriers at", 1.0, "m/s"),
    "motion": ("a drag by carriers of a receiver at rest at", 1.0, "m/s"),
    "drag": ("a drag of the position at", 1.0, "m/s"),
    "displacement": ("a move of the standing receiver, however slow, by", 1.0, "m"),
    "one_transmitter": ("one transmitter that imitates", 1.0, "satellites"),
    "elsewhere": ("a false signal whose direction is off its satellite by", math.degrees(1.0), "degrees"),
}
"""Each kind in words, with the factor from its SI unit to the unit that is shown."""


class Verdict(_Model):
    """Whether satellite-navigation signals were spoofed, how sure that is, and the positions that can be trusted."""

    format: Literal["skyproof-verdict/2"] = Field(description="Name and version of this format.")
    verdict: VerdictWord = Field(description="The answer. Never stronger than the evidence.")
    summary: str = Field(description="The answer in one sentence.")
    reason: str | None = Field(
        description="Why the word is no stronger: the failed test (suspect), why signals are not shown to "
        "be true (no_attack_seen), open signals (spoofed); null if nothing is open."
    )
    may_also_be: tuple[CauseName, ...] = Field(
        description="Other causes of a suspicion, likeliest first; empty for other words."
    )
    not_excluded: tuple[str, ...] = Field(
        description="Attacks that these tests would not see, for no_attack_seen; else empty."
    )
    remedy: str | None = Field(description="What to give or do for a stronger word; null if unknown.")
    since_gpst: Gpst | None = Field(
        description="Onset of the attack or suspicion, GPS time: middle of its interval, or when it was "
        "first seen if that has no beginning; null if none or unknown."
    )
    since_sigma_s: Sigma | None = Field(
        description="Standard deviation of the onset, seconds; null if its beginning is unknown."
    )
    since_earliest_gpst: Gpst | None = Field(
        description="Earliest onset, GPS time; null if it may have begun before the run saw it."
    )
    since_latest_gpst: Gpst | None = Field(description="Latest onset, when it was first seen, GPS time.")
    until_gpst: Gpst | None = Field(description="End of the attack, GPS time; null while it lasts.")
    false_alarm_probability_per_hour: Probability = Field(
        description="Allowed probability of calling clean signals spoofed, per hour."
    )
    wrong_statements: tuple[DoubtfulStatement, ...] = Field(
        default=(),
        description="Statements of the user that may be wrong and would explain failed tests, likeliest first.",
    )
    interference: InterferenceResult = Field(
        default=InterferenceResult(state="not_tested"),
        description="Interference; it neither shows nor excludes false signals.",
    )
    windows: tuple[WindowResult, ...] = Field(
        default=(), description="The word over time, of each receiver in order; none is worse than the verdict."
    )
    noticed: tuple[NoticedSize, ...] = Field(
        default=(), description="What the tests notice with a probability of 0.99, by receiver and kind."
    )
    assumed: str | None = Field(description="Assumptions of the word and the trusted positions; null if none.")
    receivers: tuple[ReceiverResult, ...]
    signals: tuple[Signal, ...]
    sources: tuple[Source, ...]
    methods: tuple[Method, ...]
    inputs: tuple[InputFile, ...]
    settings: dict[str, JsonValue] = Field(description="The settings in force, with units in their names.")
    versions: dict[str, str] = Field(description="Versions of the programs that made this document.")

    @model_validator(mode="after")
    def _names_point_somewhere(self) -> Self:
        receivers = {receiver.name for receiver in self.receivers}
        sources = {source.name for source in self.sources}
        for signal in self.signals:
            if signal.receiver not in receivers:
                raise ValueError(f"signal {signal.sat} is of receiver {signal.receiver}, which is not in receivers")
            if signal.source is not None and signal.source not in sources:
                raise ValueError(f"signal {signal.sat} is of source {signal.source}, which is not in sources")
        if self.verdict in ("suspect", "no_attack_seen") and not self.reason:
            raise ValueError(f"a verdict {self.verdict} says in reason why it is no stronger")
        if self.verdict == "no_attack_seen" and not self.not_excluded:
            raise ValueError("a verdict no_attack_seen says in not_excluded what it does not exclude")
        return self

    @property
    def from_start(self) -> bool:
        """Test whether the attack was on when the recording of a receiver began."""
        starts = {format_instant(r.start_gpst) for r in self.receivers if r.start_gpst is not None}
        return self.since_gpst is not None and self.since_sigma_s is None and format_instant(self.since_gpst) in starts

    @property
    def onset_words(self) -> str:
        """State when the attack or the suspicion began and ended, as far as known; empty without one."""
        if self.since_gpst is None:
            return ""
        since = format_moment(self.since_gpst)
        until = "" if self.until_gpst is None else f", until {format_moment(self.until_gpst)}"
        if self.since_sigma_s is not None:
            return f"Since {since} ± {self.since_sigma_s:.2g} s{until}"
        if self.from_start:
            return f"Since {since}, when the recording begins, or earlier{until}"
        return f"Since {since} or earlier{until}"

    @property
    def explained(self) -> tuple[tuple[str, str], ...]:
        """List what belongs to the word beside the summary: headings and words."""
        parts = (
            ("Interference:", self.interference.words),
            ("The receiver itself:", self._own_words),
            ("Not decided:", self.reason if self.verdict == "spoofed" else None),
            ("May also be:", ", or ".join(CAUSES[cause] for cause in self.may_also_be)),
            ("Would be noticed (99 %):", self._noticed_words),
            ("Not excluded:", "; ".join(self.not_excluded)),
            ("Position:", self._position_words),
            ("To resolve:", self.remedy),
            ("Cut:", _join_few(f"{input_file.path}: {text}" for input_file in self.inputs for text in input_file.cut)),
            (
                "Left out:",
                _join_few(f"{input_file.path}: {text}" for input_file in self.inputs for text in input_file.left_out),
            ),
        )
        return tuple((heading, words) for heading, words in parts if words)

    @property
    def _noticed_words(self) -> str:
        """Describe what would have been noticed, beside a word that nothing was."""
        if self.verdict not in ("authentic", "no_attack_seen"):
            return ""
        receivers: dict[str, list[str]] = {}
        for size in self.noticed:
            receivers.setdefault(size.words, []).append(size.receiver)
        every = len({size.receiver for size in self.noticed})
        return _join_few(
            words if len(names) == every else f"in {' and '.join(names)} {words}" for words, names in receivers.items()
        )

    @property
    def _position_words(self) -> str:
        """State how far the last usable positions hold, where they are not proven."""
        found = [(r, *r.usable) for r in self.receivers if r.usable is not None and r.usable[0] != "trusted"]
        return _join_few(self._usable_words(r, kind, fix) for r, kind, fix in found)

    def _usable_words(self, receiver: ReceiverResult, kind: UsableKind, fix: Position) -> str:
        within_m = radius_95_m(fix.sigma_east_m, fix.sigma_north_m)
        text = f"{receiver.name} {_HOW[kind]}: within {within_m:.1f} m horizontally (95 %) at {format_clock(fix.gpst)}"
        if fix.hidden_m == 0.0:
            return text
        if fix.hidden_m is None:
            return f"{text}; an attack that looks like motion may have moved it any distance"
        return f"{text}; an unnoticed attack since the start has moved it by {fix.hidden_m:.0f} m at most"

    @property
    def _own_words(self) -> str:
        """Describe what receivers say of themselves, where they alarm, or where only we do."""
        texts = []
        ours = self.verdict in ("suspect", "spoofed") or bool(self.interference.spells)
        for r in self.receivers:
            alarms = [s for s in r.own_states if s.alarm]
            texts += [
                f"{r.name} says {s.subject} {s.state} from {format_clock(s.since_gpst)} to {format_clock(s.until_gpst)}"
                for s in alarms
            ]
            if r.own_states and not alarms and ours:
                texts.append(f"{r.name} has no alarm of {' or '.join(dict.fromkeys(s.subject for s in r.own_states))}")
        return _join_few(texts)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.verdict!r}: {self.summary})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Show the answer, the positions and the labels in a notebook."""
        sentences = [self.summary]
        if self.since_gpst is not None:
            sentences.append(f"{self.onset_words}.")
        sentences += [f"{heading} {words}." for heading, words in self.explained]
        if self.assumed is not None:
            sentences.append(self.assumed)
        kinds = [(r.name, kind, fix) for r in self.receivers for kind, fix in r.fixes]
        positions = [
            (
                name,
                kind,
                f"{format_instant(fix.gpst)}, {format_utc(fix.gpst)}",
                f"{fix.lat_deg:.7f}",
                f"{fix.lon_deg:.7f}",
                f"{fix.height_m:.1f}",
                f"{fix.sigma_east_m:.1f}, {fix.sigma_north_m:.1f}, {fix.sigma_up_m:.1f}",
                "" if fix.hidden_m is None else f"{fix.hidden_m:.1f}",
            )
            for name, kind, fix in kinds
        ]
        positions += [
            (
                names,
                source.name,
                ""
                if source.shows_gpst is None
                else f"{format_instant(source.shows_gpst)}, {format_utc(source.shows_gpst)}",
                f"{place.lat_deg:.7f}",
                f"{place.lon_deg:.7f}",
                f"{place.height_m:.1f}",
                "",
                "",
            )
            for names, source, place in list_possible_places(self)
        ]
        sats: dict[tuple[str, str], list[str]] = {}
        for s in self.signals:
            listed_sats = sats.setdefault((s.receiver, s.label), [])
            listed_sats += [] if s.sat in listed_sats else [s.sat]
        return write_notebook_html(
            write_word(self.verdict).capitalize(),
            sentences,
            (
                (
                    "receiver",
                    "position",
                    "GPS time, UTC",
                    "latitude, °",
                    "longitude, °",
                    "height, m",
                    "σ east, north, up, m",
                    "hidden, m",
                ),
                positions,
            ),
            (("receiver", "label", "satellites"), [(*key, " ".join(listed_sats)) for key, listed_sats in sats.items()]),
        )


_SIGMAS_95: Final = 1.96  # of a normal distribution on a line


def radius_95_m(sigma_east_m: float, sigma_north_m: float) -> float:
    """Return a radius that holds 95 % or more of the horizontal errors, metres.

    Of normal errors whose variances sum to s², the circle of radius 1.96 s holds 95 % where they lie on a line, and
    97.9 % where they are as large in every direction: the correlation of east and north does not matter.
    """
    return _SIGMAS_95 * math.hypot(sigma_east_m, sigma_north_m)


def list_possible_places(verdict: Verdict) -> list[tuple[str, Source, Place]]:
    """List each sky with its receivers and place, while it is open which sky is true."""
    open_still = len(verdict.sources) > 1 and all(r.false_fix is None for r in verdict.receivers)
    names = {s.name: sorted({x.receiver for x in verdict.signals if x.source == s.name}) for s in verdict.sources}
    return [(" ".join(names[s.name]), s, s.shows) for s in verdict.sources if open_still and s.shows is not None]
