"""Judge what receivers received: the session that examines it, the decision, and the fixes that may be used."""

from collections.abc import Mapping, Sequence
from typing import Any

from skyproof.app.common.body import Body
from skyproof.app.common.epoch_source import WholeSource
from skyproof.app.common.memory import give_back
from skyproof.app.common.progress import Progress
from skyproof.app.common.session import Session, examine_all
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import instantiate_detectors, windows_of
from skyproof.app.protect.coasting import carry_track
from skyproof.app.protect.hidden import bound_drags
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.app.protect.positions import KINDS, Positions, Track, set_up_positions
from skyproof.app.protect.predictors import build_predictors, list_surveyed
from skyproof.app.protect.rest import judge_rest
from skyproof.app.protect.so_far import WordsSoFar
from skyproof.app.receive.observed import ObservedFile
from skyproof.app.receive.reception import Reception
from skyproof.detectors.prediction.choice import collect_overlapping_fixes, list_compared_skies
from skyproof.detectors.prediction.inertia import list_navigators
from skyproof.fusion.fuse import Decision, fuse
from skyproof.navigation.predictor import Predictor
from skyproof.records import FrontEndLevels, NavigationData, ReceivedMessages, ReceiverFixes, SpinArm

__all__ = ["begin_session", "choose_orbits", "find_tracks", "judge"]


def judge(
    receptions: Sequence[Reception],
    navigation: NavigationData | None,
    settings: Settings,
    progress: Progress,
    spin_arms: Sequence[SpinArm] = (),
    body: Body | None = None,
    predictors: Mapping[str, Predictor] | None = None,
    so_far: WordsSoFar | None = None,
) -> tuple[Outcome, bool]:
    """Judge what the receivers received; return the outcome, and whether an interruption left windows out.

    body : the one that carries all antennas. predictors : by receiver, for choices between skies that nothing else
        makes; from the settings alone if absent. so_far : takes each decided window.
    """
    orbits = choose_orbits(receptions, navigation)
    observed = [r.observations for r in _list_received(receptions) if r.observations is not None]
    if predictors is None:
        predictors = build_predictors([o.receiver for o in observed], settings)
    session = begin_session(receptions, orbits, settings, spin_arms, body, predictors)
    evidence, sets, interrupted = examine_all(session, progress, None if so_far is None else so_far.take)
    give_back()
    decision = fuse(evidence, observed, sets)
    navigators = list_navigators(session.state_of("inertia"))
    choosing = session.state_of("prediction")
    overlapping = collect_overlapping_fixes(evidence, choosing)
    standing_still = [o.receiver for o in observed] if settings.speed_max_m_s == 0.0 else []
    judged = (
        None
        if interrupted
        else judge_rest(
            receptions,
            decision,
            evidence,
            sets,
            lambda kept: begin_session(kept, orbits, settings, spin_arms, body, predictors),
            progress,
        )
    )
    rest, of_tests = (None, evidence) if judged is None else judged
    # Fewer signals notice less.
    hidden = bound_drags(of_tests, standing=standing_still, inertial=navigators)

    def make_outcome(reception: Reception) -> ReceiverOutcome:
        name = reception.observations.receiver if reception.observations is not None else ""
        return _make_receiver_outcome(
            reception,
            decision,
            orbits,
            settings,
            predictor=predictors.get(name),
            overlapping=overlapping.get(name, ()),
            hidden=hidden.get(name),
            rest=rest,
        )

    outcomes = [make_outcome(r) for r in receptions]
    outcome = Outcome(
        receivers=tuple(outcomes),
        decision=decision,
        evidence=evidence,
        sets=sets,
        navigation=orbits,
        compared=list_compared_skies(choosing),
        rest=rest,
    )
    return outcome, interrupted


def choose_orbits(receptions: Sequence[Reception], navigation: NavigationData | None) -> NavigationData:
    """Choose the orbits of the navigation file, else those that the signals of all receivers sent."""
    return navigation if navigation is not None else _merge_navigation([r.decoded for r in receptions])


def begin_session(
    receptions: Sequence[Reception],
    orbits: NavigationData,
    settings: Settings,
    spin_arms: Sequence[SpinArm],
    body: Body | None,
    predictors: Mapping[str, Predictor],
) -> Session:
    """Begin the session that examines what receivers received, with every installed detector."""
    received = _list_received(receptions)
    windows = windows_of(
        [WholeSource(r.observations) for r in received if r.observations is not None],
        orbits,
        settings,
        taps=[r.taps for r in received if r.taps is not None],
        vector_taps=[r.vector_taps for r in received if r.vector_taps is not None],
        ccaf=[r.ccaf for r in received if r.ccaf is not None],
        array_phases=[r.array_phases for r in received if r.array_phases is not None],
        spin_arms=spin_arms,
        body=body,
        levels=_collect_levels(received),
        messages=_collect_messages(received),
        own_fixes=_collect_own_fixes(received),
        predictors=predictors,
        changes={r.source.name: r.changes for r in received if r.changes is not None},
        apart_from={r.source.name: r.apart_from for r in received},
    )
    return Session(windows, instantiate_detectors(settings, windows.run, positions_ecef_m=list_surveyed(predictors)))


def _list_received(receptions: Sequence[Reception]) -> list[Reception]:
    """List the receptions with two epochs or more."""
    return [r for r in receptions if r.observations is not None and r.observations.gpst.size > 1]


def _collect_levels(receptions: Sequence[Reception]) -> dict[str, FrontEndLevels]:
    """Collect the front ends' levels of the logs that have them, by receiver."""
    sources = [r.source for r in receptions]
    return {s.name: s.own.levels for s in sources if isinstance(s, ObservedFile) and s.own.levels is not None}


def _collect_own_fixes(receptions: Sequence[Reception]) -> dict[str, ReceiverFixes]:
    """Collect the fixes that receivers computed themselves, of the logs that have them, by receiver."""
    sources = [r.source for r in receptions]
    return {s.name: s.own.fixes for s in sources if isinstance(s, ObservedFile) and s.own.fixes is not None}


def _collect_messages(receptions: Sequence[Reception]) -> dict[str, ReceivedMessages]:
    """Collect the broadcast messages of the logs that have them, by receiver."""
    sources = [r.source for r in receptions]
    return {s.name: s.own.messages for s in sources if isinstance(s, ObservedFile) and s.own.messages is not None}


def _make_receiver_outcome(
    reception: Reception, decision: Decision, orbits: NavigationData, settings: Settings, **of_receiver: Any
) -> ReceiverOutcome:
    """Compute the positions of one receiver. of_receiver : further arguments of `set_up_positions`."""
    o = reception.observations
    if o is None or not orbits.ephemerides:
        return ReceiverOutcome(reception=reception)
    positions = set_up_positions(o, decision, orbits, settings, **of_receiver)
    return ReceiverOutcome(reception=reception, positions=positions, tracks=find_tracks(positions))


def find_tracks(positions: Positions) -> dict[str, Track]:
    """Find the tracks of all kinds of positions that have a fix, in the order of `KINDS`."""
    tracks: dict[str, Track | None] = {kind: positions.track(kind) for kind in positions.masks}
    if (carried := carry_track(positions)) is not None:
        tracks |= [carried]
    give_back()
    order = [kind for kind in KINDS if kind in tracks]
    found = {kind: tracks[kind] for kind in dict.fromkeys([*order, *tracks])}
    return {kind: track for kind, track in found.items() if track is not None}


def _merge_navigation(decoded: Sequence[NavigationData]) -> NavigationData:
    """Merge what all receivers' signals sent, each data set once."""
    sets = {(e.sat, e.week, e.toe, getattr(e, "message", "")): e for data in decoded for e in data.ephemerides}
    ionosphere = next((d.ionosphere for d in decoded if d.ionosphere is not None), None)
    utc = next((d.utc for d in decoded if d.utc is not None), None)
    return NavigationData(
        ephemerides=tuple(sets[key] for key in sorted(sets)), ionosphere=ionosphere, utc=utc, source="the signals"
    )
