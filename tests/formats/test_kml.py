"""Tracks as KML: valid XML, one placemark a kind, UTC."""

from xml.etree import ElementTree

import numpy as np
import pytest

from skyproof.formats.kml import write_kml, write_kml_lines

KML, GX = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"


def track(n_points=3, lat_deg=59.41):
    gpst = np.datetime64("2022-01-01T21:45:58.5", "ns") + np.arange(n_points) * np.timedelta64(1, "s")
    return gpst, lat_deg + 1e-5 * np.arange(n_points), np.full(n_points, -16.88), np.full(n_points, 52.125)


def make_document(tracks, **more):
    root = ElementTree.fromstring("\n".join(write_kml_lines(tracks, **more)).encode())
    assert root.tag == f"{KML}kml"
    assert len(root) == 1
    return root[0]


def list_placemarks(tracks):
    return {p.findtext(f"{KML}name"): p for p in make_document(tracks).iter(f"{KML}Placemark")}


def test_every_kind_is_a_placemark_with_a_style_of_its_own():
    found = list_placemarks({"trusted": track(), "false": track(4), "unprotected": track(5)})
    styles = {s.get("id"): s for s in make_document({}).iter(f"{KML}Style")}
    assert list(found) == ["trusted", "false", "unprotected"]
    assert [p.findtext(f"{KML}styleUrl") for p in found.values()] == ["#trusted", "#false", "#unprotected"]
    colours = {styles[name].findtext(f"{KML}LineStyle/{KML}color") for name in found}
    assert len(colours) == 3
    assert [len(p.findall(f"{GX}Track/{GX}coord")) for p in found.values()] == [3, 4, 5]


def test_points_carry_utc_and_longitude_first():
    (placemark,) = list_placemarks({"rx1 trusted": track()}).values()
    points = placemark.find(f"{GX}Track")
    assert points.findtext(f"{KML}when") == "2022-01-01T21:45:40.500Z"  # GPS time is 18 s ahead
    assert points.findtext(f"{GX}coord") == "-16.880000000 59.410000000 52.125"
    assert points.findtext(f"{KML}altitudeMode") == "clampToGround"
    assert [child.tag for child in points] == [f"{KML}altitudeMode"] + [f"{KML}when"] * 3 + [f"{GX}coord"] * 3


def test_points_without_a_position_and_empty_tracks_are_left_out():
    gpst, lat_deg, lon_deg, height_m = track()
    lat_deg[1] = np.nan
    found = list_placemarks({"trusted": (gpst, lat_deg, lon_deg, height_m), "false": track(0)})
    assert list(found) == ["trusted"]
    assert len(found["trusted"].findall(f"{GX}Track/{KML}when")) == 2
    assert len(found["trusted"].findall(f"{GX}Track/{GX}coord")) == 2


def test_names_of_any_kind_stay_valid_xml():
    name = 'a<b>&"c"\x00\x1f rx'
    found = make_document({f"{name} false": track()}, name=name)
    assert found.findtext(f"{KML}name") == 'a<b>&"c"   rx'


def test_a_track_of_no_kind_is_refused(tmp_path):
    path = tmp_path / "a.kml"
    with pytest.raises(ValueError, match="trusted, consistent, inertial, held, false, unprotected"):
        write_kml(path, {"trusted rx1": track()})
    assert not path.exists()


def test_the_file_is_utf8(tmp_path):
    path = tmp_path / "a.kml"
    write_kml(path, {"Höjd trusted": track()})
    root = ElementTree.parse(path).getroot()
    assert root.findtext(f".//{KML}Placemark/{KML}name") == "Höjd trusted"


def test_points_lines_and_areas_are_drawn_as_such():
    shapes = {
        "S1 stands here": ([59.0], [-16.0]),
        "S1 from rx1": ([59.0, 59.1], [-16.0, -16.2]),
        "S1 within": ([59.0, 59.1, 59.2, 59.0], [-16.0, -16.2, -16.1, -16.0]),
    }
    root = ElementTree.fromstring("\n".join(write_kml_lines({}, shapes)).encode())
    found = {p.findtext(f"{KML}name"): p for p in root.iter(f"{KML}Placemark")}
    assert list(found) == list(shapes)
    point, line, area = found.values()
    assert point.findtext(f"{KML}Point/{KML}coordinates") == "-16.000000000,59.000000000"
    assert len(line.findtext(f"{KML}LineString/{KML}coordinates").split()) == 2
    ring = area.findtext(f"{KML}Polygon/{KML}outerBoundaryIs/{KML}LinearRing/{KML}coordinates").split()
    assert len(ring) == 4
    assert ring[0] == ring[-1]
