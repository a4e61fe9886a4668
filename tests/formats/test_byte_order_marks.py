"""Every door of text takes the byte order mark of UTF-8, and names an encoding that it does not read."""

import gzip

import pytest
from tests.fuzz.readers import READERS

from skyproof.app.fleet.catalogue import read_catalogue
from skyproof.errors import InputError, ScenarioError, SkyproofError
from skyproof.formats.rinex_obs_pieces import read_obs_pieces
from skyproof.formats.rinex_obs_read import holds_observations
from skyproof.formats.signatures import identify_other

MARK = b"\xef\xbb\xbf"
DOORS = [name for name in READERS if name not in ("archive", "bytes", "any")]


def write(folder, name, content):
    reader = READERS[name]
    for beside, octets in reader.beside:
        (folder / beside).write_bytes(octets)
    path = folder / reader.name
    path.write_bytes(content)
    return path


def list_text_seeds(name):
    return [seed for seed in READERS[name].seeds if seed[:2] != b"\x1f\x8b"]


@pytest.mark.parametrize("name", DOORS)
def test_a_mark_of_utf_8_changes_nothing(tmp_path, name):
    read = 0
    for seed in list_text_seeds(name):
        try:
            READERS[name].read(write(tmp_path, name, seed))
        except SkyproofError as error:
            with pytest.raises(type(error)):
                READERS[name].read(write(tmp_path, name, MARK + seed))
            continue
        READERS[name].read(write(tmp_path, name, MARK + seed))
        read += 1
    assert read


@pytest.mark.parametrize("name", ["nav", "obs"])
def test_a_mark_within_a_gzip_file_is_taken(tmp_path, name):
    READERS[name].read(write(tmp_path, name, gzip.compress(MARK + list_text_seeds(name)[0])))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "utf-32-be"])
@pytest.mark.parametrize("name", [name for name in DOORS if name != "log"])  # which is known by its content
def test_text_of_another_encoding_is_named(tmp_path, name, encoding):
    text = list_text_seeds(name)[0].decode("latin-1")
    content = ("" if encoding == "utf-16" else "\ufeff") + text
    with pytest.raises((InputError, ScenarioError), match=r"UTF-(16|32).*UTF-8"):
        READERS[name].read(write(tmp_path, name, content.encode(encoding)))


def test_an_input_of_protect_with_a_mark_is_an_observation_file(tmp_path):
    seed = list_text_seeds("obs")[0]
    path = write(tmp_path, "obs", MARK + seed)
    assert holds_observations(path)
    marked, plain = (next(read_obs_pieces([content])) for content in (MARK + seed, seed))
    assert marked.observations.signals == plain.observations.signals


def test_an_observation_file_in_utf_16_is_no_recording(tmp_path):
    path = write(tmp_path, "obs", list_text_seeds("obs")[0].decode().encode("utf-16"))
    assert identify_other(path.read_bytes()[:4096])[0] == "text in UTF-16"


def test_a_catalogue_with_a_mark_is_read(tmp_path):
    path = tmp_path / "all.csv"
    path.write_bytes(MARK + b"name,inputs\nmast,mast.obs\n")
    assert [item.name for item in read_catalogue(path)] == ["mast"]
