"""Skies of one receiver over the windows, and when they came."""

from skyproof.fusion.skies import date_sky, link_skies

GPS = ("G05a", "G07a", "G10a", "G13a", "G15a")
GALILEO = ("E05a", "E07a", "E10a", "E13a", "E15a")


def test_skies_that_parted_are_not_dated_by_when_they_were_found(invented):
    o = invented.observations((*GPS, *GALILEO))
    sets = [
        invented.sky(0, *GPS, *GALILEO),
        invented.sky(1, *GPS),
        invented.sky(1, *GALILEO),
    ]
    skies = link_skies(sets)
    assert [sky.parted for sky in skies] == [True, True]
    assert [date_sky(sky, [o]) for sky in skies] == [None, None]


def test_skies_that_are_two_from_the_first_window_on_were_there(invented):
    o = invented.observations((*GPS, *GALILEO))
    skies = link_skies([invented.sky(0, *GPS), invented.sky(0, *GALILEO)])
    assert [sky.parted for sky in skies] == [False, False]
    assert all(date_sky(sky, [o]).from_start for sky in skies)


def test_second_signals_are_dated_by_the_search(invented):
    second = ("G05b", "G07b", "G10b", "G13b", "G15b")
    o = invented.observations((*GPS, *second), found=dict.fromkeys(second, (11.0, 12.0)))
    skies = link_skies([invented.sky(0, *GPS), invented.sky(1, *GPS), invented.sky(1, *second)])
    assert [sky.parted for sky in skies] == [False, False]
    assert sorted(date_sky(sky, [o]).seen for sky in skies) == [invented.at(0), invented.at(12.02)]
