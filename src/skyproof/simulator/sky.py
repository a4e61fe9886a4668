"""Work out what each antenna receives in a scenario."""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.gnss.time import format_iso
from skyproof.records import SignalId
from skyproof.simulator.attacks import Meaconer, Takeover
from skyproof.simulator.clocks import Clock, make_clock
from skyproof.simulator.motion import Motion, Trajectory
from skyproof.simulator.platforms import Point, compute_motion, make_antenna_point, make_trajectory, require_span
from skyproof.simulator.ranges import fit_orbits
from skyproof.simulator.received import AddedNoise, Jammer, Ray, ReceivedSignal, ReceiverSky, Scene, select_ephemeris
from skyproof.simulator.scenario import Antenna, Multipath, Scenario, SceneReceiver
from skyproof.simulator.sites import Site
from skyproof.simulator.transmitters import (
    NEAREST_M,
    Attacker,
    Group,
    Radio,
    compute_added_noise,
    compute_interference,
    lead_away,
    make_false_signals,
)
from skyproof.simulator.view import KNOT_S, View, compute_patch_db, find_when_above

__all__ = ["make_scene"]

_MARGIN_S = 4.0


def make_scene(scenario: Scenario, navigation: NavigationData, *, sats: Sequence[str] = GPS_SATS) -> Scene:
    """Work out which antenna receives which signals.

    sats : that there are. Those of other systems than GPS are for measurements only (`kinds`): nothing renders their
    codes.

    Raises
    ------
    ScenarioError : no satellite is in view, or the navigation data belong to another time; an attack imitates a
    satellite that cannot be seen from the place it shows; a path does not cover the scene or leads underground; a
    receiver comes too near to a transmit antenna.
    """
    world = _World(scenario, navigation, sats)
    antennas = [(index, antenna) for index, receiver in enumerate(scenario.receivers) for antenna in receiver.antennas]
    skies = tuple(world.sky(index, antenna, number) for number, (index, antenna) in enumerate(antennas))
    onsets_s = [np.array([attacker.attack.onset_s]) for attacker in world.attackers]
    path_m = [
        [SPEED_OF_LIGHT_M_S * float(attacker.radios[0].flight_s(onset_s, sky.point(onset_s))[0]) for sky in skies]
        for attacker, onset_s in zip(world.attackers, onsets_s, strict=True)
    ]
    return Scene(
        scenario=scenario,
        navigation=navigation,
        skies=skies,
        path_m=np.array(path_m).reshape(-1, len(skies)),
        trajectories=dict(zip((r.name for r in scenario.receivers), world.trajectories, strict=True)),
        shown=tuple(attacker.view.point for attacker in world.attackers),
    )


class _World:
    """What all antennas of a scene share."""

    def __init__(self, scenario: Scenario, navigation: NavigationData, sats: Sequence[str]) -> None:
        self.scenario, self.navigation = scenario, navigation
        ephemerides = [eph for sat in sats if (eph := select_ephemeris(navigation, sat, scenario)) is not None]
        if not ephemerides:
            raise ScenarioError(
                f"start_gpst: {navigation.source or 'the navigation data'} has no healthy satellite for "
                f"{format_iso(scenario.start_gpst, 0)}; give the navigation file of that day"
            )
        starts_s = [receiver.start_offset_s for receiver in scenario.receivers]
        first_s, last_s = min(starts_s) - _MARGIN_S, max(starts_s) + scenario.duration_s + _MARGIN_S
        self.knots_s: Reals = first_s + KNOT_S * np.arange(int(np.ceil((last_s - first_s) / KNOT_S)) + 1.0)
        self.orbits = fit_orbits(ephemerides, scenario.start_gpst, first_s - 2.0, float(self.knots_s[-1]) + 2.0)
        self.trajectories = [
            self._make_trajectory(receiver, f"receivers[{index}]", receiver.start_offset_s)
            for index, receiver in enumerate(scenario.receivers)
        ]
        self.clocks = [self._make_clock(index) for index in range(len(scenario.receivers))]
        self.first = self._find_first_antenna(0)  # powers are stated for it
        self.cn0_dbhz = scipy.interpolate.CubicSpline(
            self.knots_s, self._compute_level_dbhz(self._make_view(self.first).el_rad)
        )
        self.attackers = [self._make_attacker(number) for number in range(len(scenario.attacks))]

    def _make_trajectory(self, site: Site, where: str, from_s: float = 0.0) -> Trajectory:
        trajectory = make_trajectory(site, where)
        require_span(trajectory, from_s, from_s + self.scenario.duration_s, where)
        return trajectory

    def _find_first_antenna(self, receiver: int) -> Point:
        """Return a receiver's first antenna or, if it is on an arm, its centre: no transmitter knows more."""
        antenna = self.scenario.receivers[receiver].antennas[0].model_copy(update={"spin": None})
        return make_antenna_point(self.trajectories[receiver], antenna)

    def _make_view(self, point: Point) -> View:
        return View(point, self.orbits, self.knots_s, self.scenario, self.navigation.ionosphere)

    def _make_clock(self, index: int) -> Clock | None:
        receiver = self.scenario.receivers[index]
        if receiver.oscillator is None:
            return None
        return make_clock(
            receiver.oscillator,
            drift=receiver.lo_ppm * 1e-6,
            seed=self.scenario.seed,
            stream=index,
            duration_s=self.scenario.duration_s + _MARGIN_S,
        )

    def _make_attacker(self, number: int) -> Attacker:
        scenario, attack = self.scenario, self.scenario.attacks[number]
        where = f"attacks[{number}]"
        keys = ["transmit", *(f"antennas[{place}]" for place in range(len(attack.antennas)))]
        radios = tuple(
            Radio(self._make_trajectory(site, f"{where}.{key}"), self.first, attack.onset_s)
            for key, site in zip(keys, (attack.transmit, *attack.antennas), strict=True)
        )
        target = true = None
        if isinstance(attack, Takeover):
            target = self._find_first_antenna([receiver.name for receiver in scenario.receivers].index(attack.target))
            true = self._make_view(target)
            shown = lead_away(target, attack)
        else:
            key = "receive" if isinstance(attack, Meaconer) else "shows"
            trajectory = self._make_trajectory(attack.shows, f"{where}.{key}")

            def shown(at_s: Reals) -> Motion:
                return compute_motion(trajectory, at_s)

        return Attacker(
            number=number,
            name=scenario.attack_names[number],
            seed=scenario.seed,
            attack=attack,
            radios=radios,
            view=self._make_view(shown),
            target=target,
            true=true,
        )

    def _compute_level_dbhz(self, el_rad: Reals) -> Reals:
        sky = self.scenario.sky
        span_db = sky.zenith_cn0_dbhz - sky.horizon_cn0_dbhz
        return np.asarray(sky.horizon_cn0_dbhz + span_db * np.maximum(np.sin(el_rad), 0.0))

    def sky(self, index: int, antenna: Antenna, number: int) -> ReceiverSky:
        """Compute what one antenna receives; `number` counts antennas over all receivers."""
        scenario, receiver = self.scenario, self.scenario.receivers[index]
        point = make_antenna_point(self.trajectories[index], antenna)
        groups = [self._list_true_signals(self._make_view(point), antenna)]
        for attacker in self.attackers:
            self._require_distance(attacker, receiver, point)
            groups.append(
                make_false_signals(
                    attacker, point, antenna, self.cn0_dbhz, knots_s=self.knots_s, mask_deg=scenario.mask_deg
                )
            )
        received = [signal for group in groups for signal in group.received]
        if not received:
            raise ScenarioError(
                f"mask_deg: nothing stands above {scenario.mask_deg:g} degrees at receiver {receiver.name}; lower the "
                "mask"
            )
        order = sorted(range(len(received)), key=lambda column: received[column].id)
        signals = tuple(received[column] for column in order)
        bias_s = antenna.line_bias_cyc / GPS_L1_CA.carrier_hz

        def delays_s(true_s: Reals) -> tuple[Reals, Reals]:
            here = point(true_s)
            code_s, carrier_s = zip(*(group.delays_s(true_s, here) for group in groups), strict=True)
            return np.concatenate(code_s, axis=1)[:, order], np.concatenate(carrier_s, axis=1)[:, order] + bias_s

        def cn0_dbhz(true_s: ArrayLike) -> Reals:
            at_s = np.asarray(true_s, np.float64)
            here = point(at_s.ravel())
            level_dbhz = np.concatenate([group.cn0_dbhz(at_s.ravel(), here) for group in groups], axis=1)
            return level_dbhz[:, order].reshape(*at_s.shape, len(order))

        el_rad = np.concatenate([group.el_rad for group in groups], axis=1)[:, order]
        disturbers = list(self._iterate_disturbers(point))
        return ReceiverSky(
            receiver=receiver,
            antenna=antenna,
            number=number,
            name=receiver.name if len(receiver.antennas) == 1 else f"{receiver.name}.{antenna.name}",
            signals=signals,
            delays_s=delays_s,
            cn0_dbhz=cn0_dbhz,
            point=point,
            knots_s=self.knots_s,
            az_rad=np.concatenate([group.az_rad for group in groups], axis=1)[:, order],
            el_rad=el_rad,
            clock=self.clocks[index],
            rays=tuple(self._iterate_rays(receiver, antenna, signals, el_rad)),
            noises=tuple(other for other in disturbers if not isinstance(other, Jammer)),
            jammers=tuple(other for other in disturbers if isinstance(other, Jammer)),
        )

    def _list_true_signals(self, view: View, antenna: Antenna) -> Group:
        sats = self.orbits.sats
        wanted = sats if self.scenario.sky.sats is None else self.scenario.sky.sats
        until_s = np.inf if self.scenario.sky.until_s is None else self.scenario.sky.until_s
        above = [find_when_above(el_rad, self.knots_s, self.scenario.mask_deg) for el_rad in view.el_rad.T]
        kept = [
            (col, (window[0], min(window[1], until_s)))
            for col, window in enumerate(above)
            if window is not None and window[0] < until_s and sats[col] in wanted
        ]
        columns = np.array([column for column, _ in kept], np.int64)
        level_dbhz = scipy.interpolate.CubicSpline(self.knots_s, self._compute_level_dbhz(view.el_rad[:, columns]))

        def delays_s(true_s: Reals, here: Motion) -> tuple[Reals, Reals]:
            return view.delays_from_s(true_s, here, columns)

        def cn0_dbhz(true_s: Reals, here: Motion) -> Reals:
            if antenna.gain == "isotropic":
                return np.asarray(level_dbhz(true_s))
            toward = self.orbits.compute_sight(true_s, here.position_ecef_m, columns).toward
            return np.asarray(level_dbhz(true_s) + compute_patch_db(toward, here.position_ecef_m, here.attitude))

        return Group(
            received=tuple(
                ReceivedSignal(SignalId(sats[column]), "sky", "authentic", (window,)) for column, window in kept
            ),
            delays_s=delays_s,
            cn0_dbhz=cn0_dbhz,
            az_rad=view.az_rad[:, columns],
            el_rad=view.el_rad[:, columns],
        )

    def _require_distance(self, attacker: Attacker, receiver: SceneReceiver, point: Point) -> None:
        at_s = receiver.start_offset_s + np.linspace(0.0, self.scenario.duration_s, 100)
        motion = point(at_s)
        nearest_m = SPEED_OF_LIGHT_M_S * min(float(radio.flight_s(at_s, motion).min()) for radio in attacker.radios)
        if nearest_m < NEAREST_M:
            raise ScenarioError(
                f"attacks[{attacker.number}].transmit: {nearest_m:.2f} m from receiver {receiver.name}, expected at "
                f"least {NEAREST_M:g} m; move one of them"
            )

    def _iterate_disturbers(self, point: Point) -> Iterator[AddedNoise]:
        """Iterate over noise and interference."""
        for attacker in self.attackers:
            noise = compute_added_noise(attacker, point)
            if noise is not None:
                yield noise
        for number, source in enumerate(self.scenario.interference):
            trajectory = self._make_trajectory(source.transmit, f"interference[{number}].transmit")
            yield compute_interference(source, Radio(trajectory, self.first, source.onset_s), point)

    def _iterate_rays(
        self, receiver: SceneReceiver, antenna: Antenna, signals: tuple[ReceivedSignal, ...], el_rad: Reals
    ) -> Iterator[Ray]:
        for reflection in receiver.multipath:
            if antenna.name not in (reflection.antennas or (antenna.name,)):
                continue
            for column, received in enumerate(signals):
                if received.label == "authentic" and received.id.sat in (reflection.sats or (received.id.sat,)):
                    yield self._make_ray(reflection, column, el_rad[:, column])

    def _make_ray(self, reflection: Multipath, column: int, el_rad: Reals) -> Ray:
        if reflection.height_m is not None:
            longer_m = 2.0 * reflection.height_m * np.maximum(np.sin(el_rad), 0.0)
        else:
            longer_m = np.full(el_rad.shape, reflection.delay_m)
        return Ray(
            of=column,
            further_s=scipy.interpolate.CubicSpline(self.knots_s, longer_m / SPEED_OF_LIGHT_M_S),
            amplitude=10.0 ** (reflection.power_db / 20.0),
            phase_cyc=reflection.phase_deg / 360.0,
            rate_hz=reflection.rate_hz,
        )
