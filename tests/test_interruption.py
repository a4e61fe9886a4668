"""A first signal is noted or raised, a pair is one wish, a second signal ends everything."""

import signal

import pytest

from skyproof.interruption import ENDING, Stopped, defer, get_exit_code, has_come, listen, raise_at_signal, watch


def send(*numbers: signal.Signals) -> None:
    for number in numbers:
        signal.raise_signal(number)


@pytest.fixture(autouse=True)
def ctrl_c(monkeypatch):
    """Send Ctrl-C as in the foreground: a shell's background jobs ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", ENDING)
def test_a_first_signal_is_raised(number):
    with listen(*ENDING):
        assert not has_come()
        with pytest.raises(KeyboardInterrupt):
            send(number)
        assert has_come()
        assert get_exit_code() == 128 + number


def test_a_first_signal_is_noted_where_it_would_lose_something():
    with listen(*ENDING), defer():
        ended = watch()
        send(signal.SIGTERM)
        assert ended()
        assert not watch()()  # whoever asks from now on waits for none
        with raise_at_signal():
            pass


def test_a_signal_is_raised_within_a_deferral_where_it_is_heard():
    with listen(*ENDING), defer():
        with pytest.raises(KeyboardInterrupt), raise_at_signal():
            send(signal.SIGTERM)
        assert has_come()


@pytest.mark.parametrize("pair", [(signal.SIGTERM, signal.SIGTERM), (signal.SIGTERM, signal.SIGHUP)])
def test_a_pair_of_signals_is_one_wish(pair):
    with listen(*ENDING), defer():
        send(*pair)
        assert get_exit_code() == 128 + pair[0]


@pytest.mark.parametrize("numbers", [(signal.SIGINT, signal.SIGINT), (signal.SIGTERM, signal.SIGINT)])
def test_ctrl_c_after_a_signal_ends_all_and_the_next_one_kills(numbers):
    with listen(*ENDING), defer():
        with pytest.raises(Stopped):
            send(*numbers)
        assert {signal.getsignal(number) for number in ENDING} == {signal.SIG_DFL}


def test_a_later_signal_ends_all(monkeypatch):
    monkeypatch.setattr("skyproof.interruption.PAIR_S", 0.0)
    with listen(*ENDING), defer(), pytest.raises(Stopped):
        send(signal.SIGHUP, signal.SIGTERM)


def test_what_was_handled_before_is_handled_so_again():
    before = [signal.getsignal(number) for number in ENDING]
    with listen(*ENDING):
        with listen(*ENDING):
            pass
        assert signal.getsignal(signal.SIGHUP) is not before[-1]
    assert [signal.getsignal(number) for number in ENDING] == before


def test_an_ignored_signal_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # nohup
    try:
        with listen(*ENDING):
            send(signal.SIGHUP)
            assert not has_come()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_ctrl_c_in_a_notebook_is_noted_too():
    with defer():
        send(signal.SIGINT)
        assert has_come()
    with pytest.raises(KeyboardInterrupt):
        send(signal.SIGINT)
