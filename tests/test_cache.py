"""The cache gives back what it was given or nothing, and two questions never share a key."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexdesign.core import result_cache
from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Cache, content_key, default_folder

ARRAYS = {"points": np.arange(12.0).reshape(4, 3), "tets": np.array([[0, 1, 2, 3]]), "none": np.zeros((0, 3))}
TABLE = {"facts": {"unknowns": 12, "solver": "SuperLU"}, "seconds": 0.25, "modes": [1.5, None]}
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
)


def files(folder: Path) -> list[str]:
    """Return the names of the files under a folder."""
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def test_gives_back_what_was_stored(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "deep" / "down")
    assert cache.load("mesh", "key") is None
    cache.store("mesh", "key", ARRAYS, TABLE)
    stored = cache.load("mesh", "key")
    assert stored is not None
    arrays, table = stored
    assert table == TABLE
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array, strict=True)
    assert cache.load("solution", "key") is None


def test_storing_again_replaces(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    for seconds in (1.0, 2.0):
        cache.store("mesh", "key", ARRAYS, {"seconds": seconds})
    stored = cache.load("mesh", "key")
    assert stored is not None and stored[1] == {"seconds": 2.0}
    assert files(tmp_path) == ["key.npz"]


def test_an_entry_appears_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = Cache(tmp_path)
    cache.store("mesh", "key", ARRAYS, {"seconds": 1.0})

    def stopped(file: io.IOBase, **_: object) -> None:
        file.write(b"half of it")
        assert cache.load("mesh", "key") is not None  # a reader meanwhile sees the old entry
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", stopped)
    with pytest.raises(KeyboardInterrupt):
        cache.store("mesh", "key", ARRAYS, {"seconds": 2.0})
    stored = cache.load("mesh", "key")
    assert stored is not None and stored[1] == {"seconds": 1.0}
    assert files(tmp_path) == ["key.npz"]


@pytest.fixture(scope="module")
def entry(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("entry")
    Cache(folder).store("mesh", "key", ARRAYS, TABLE)
    return (folder / "mesh" / "key.npz").read_bytes()


def load_bytes(folder: Path, content: bytes) -> tuple[dict[str, Any], dict[str, Any]] | None:
    """Load an entry that consists of `content`."""
    path = folder / "mesh" / "key.npz"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    return Cache(folder).load("mesh", "key")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.9, 0.999])
def test_a_truncated_entry_counts_as_none(tmp_path: Path, entry: bytes, share: float) -> None:
    assert load_bytes(tmp_path, entry[: int(share * len(entry))]) is None


def test_an_entry_that_is_something_else_counts_as_none(tmp_path: Path) -> None:
    array, archive = io.BytesIO(), io.BytesIO()
    np.save(array, np.ones(3))
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("points.npy", b"none")
    for content in (b"none", array.getvalue(), archive.getvalue(), os.urandom(100)):
        assert load_bytes(tmp_path, content) is None


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_damaged_entry_counts_as_none_or_is_right(tmp_path: Path, entry: bytes, data: st.DataObject) -> None:
    """A wrong byte where nothing is stored, as in a time stamp, does no harm; no other is let through."""
    place = data.draw(st.integers(0, len(entry) - 1))
    wrong = data.draw(st.integers(1, 255))
    damaged = entry[:place] + bytes([entry[place] ^ wrong]) + entry[place + 1 :]
    stored = load_bytes(tmp_path, damaged)
    if stored is not None:
        arrays, table = stored
        for name in arrays.keys() & ARRAYS.keys():
            np.testing.assert_array_equal(arrays[name], ARRAYS[name])
        assert table == TABLE


def test_a_key_depends_on_everything() -> None:
    base = (1, "mesh", {"size": 0.1, "libraries": {"numpy": "2.0"}}, np.arange(3.0), [1.5, None])
    changed = [
        (2, *base[1:]),
        (True, *base[1:]),
        ("1", *base[1:]),
        (1, "mash", *base[2:]),
        (*base[:2], {"size": 0.1, "libraries": {"numpy": "2.1"}}, *base[3:]),
        (*base[:2], {"size": 0.10000000000000002, "libraries": {"numpy": "2.0"}}, *base[3:]),
        (*base[:3], np.arange(3), base[4]),
        (*base[:3], np.arange(3.0).astype(np.float32), base[4]),
        (*base[:3], np.arange(3.0)[:, None], base[4]),
        (*base[:3], np.arange(3.0) + np.array([0, 0, 1e-15]), base[4]),
        (*base[:4], [1.5, 0]),
        base[:4],
        (*base, None),
    ]
    keys = [content_key(*parts) for parts in [base, *changed]]
    assert len(set(keys)) == len(keys)


def test_a_key_does_not_depend_on_order_or_memory() -> None:
    a = np.arange(6.0).reshape(2, 3)
    assert content_key({"a": 1, "b": 2}) == content_key({"b": 2, "a": 1})
    assert content_key(a) == content_key(np.asfortranarray(a)) == content_key(a.copy())
    assert content_key(a[:, ::2]) == content_key(a[:, ::2].copy())


def test_neighbours_do_not_run_together() -> None:
    assert content_key(1, 23) != content_key(12, 3)
    assert content_key(0.15, 0.45) != content_key(0.1, 50.45)
    assert content_key("a", "b") != content_key("ab") != content_key('a""b')
    assert content_key(np.ones(2), np.ones(2)) != content_key(np.ones(4))


def test_long_arrays_in_tables_count_to_the_last_number() -> None:
    long = np.zeros(10_000)
    other = long.copy()
    other[5_000] = 1e-12
    assert content_key({"field": long}) != content_key({"field": other})


@given(JSON, JSON)
def test_different_tables_have_different_keys(a: object, b: object) -> None:
    assert (content_key(a) == content_key(b)) == (repr(_sorted(a)) == repr(_sorted(b)))


def _sorted(value: object) -> object:
    if isinstance(value, dict):
        return {key: _sorted(value[key]) for key in sorted(value)}
    return [_sorted(piece) for piece in value] if isinstance(value, list) else value


def test_the_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEXDESIGN_CACHE", "/chosen")
    monkeypatch.setenv("XDG_CACHE_HOME", "/xdg")
    assert default_folder() == Path("/chosen")
    monkeypatch.delenv("FLEXDESIGN_CACHE")
    assert default_folder() == Path("/xdg/flexdesign")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/someone")
    assert default_folder() == Path("/home/someone/.cache/flexdesign")


# --- Checksums, processes, and what is left behind


def test_an_array_that_is_lost_is_noticed(tmp_path: Path, entry: bytes) -> None:
    """Of a name in the directory of the archive no checksum of its own knows."""
    content = entry.replace(b"points.npy", b"pointz.npy")
    assert content != entry
    assert load_bytes(tmp_path, content) is None
    assert str(tmp_path / "mesh" / "key.npz") in result_cache.damaged()


def test_another_number_is_noticed(tmp_path: Path) -> None:
    """As a file that was written by hand, or by an archive tool that repairs checksums."""
    Cache(tmp_path).store("mesh", "key", ARRAYS, TABLE)
    path = tmp_path / "mesh" / "key.npz"
    with np.load(path) as stored:
        content = {name: stored[name] for name in stored.files}
    content["points"] = content["points"] + 1e-12
    np.savez_compressed(path, **content)
    assert Cache(tmp_path).load("mesh", "key") is None


def test_an_entry_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mesh" / "key.npz"
    path.parent.mkdir()
    np.savez_compressed(path, **ARRAYS, table=np.array('{"a": 1}'))
    stored = Cache(tmp_path).load("mesh", "key")
    assert stored is not None and stored[1] == {"a": 1}


def test_a_damaged_entry_is_made_anew_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(result_cache, "_damaged", {})
    cache = Cache(tmp_path)
    cache.store("mesh", "key", ARRAYS, TABLE)
    path = tmp_path / "mesh" / "key.npz"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)
    assert cache.load("mesh", "key") is None and result_cache.damaged() == (str(path),)
    cache.store("mesh", "key", ARRAYS, TABLE)
    assert cache.load("mesh", "key") is not None


WRITER = """
import sys, numpy as np
from pathlib import Path
from flexdesign.core.result_cache import Cache
cache, number = Cache(Path(sys.argv[1])), int(sys.argv[2])
for k in range(60):
    cache.store("mesh", "key", {"points": np.full(20000, 7.0)}, {"by": number})
    found = cache.load("mesh", "key")
    assert found is not None and (found[0]["points"] == 7.0).all(), k
"""


def test_two_processes_share_a_folder(tmp_path: Path) -> None:
    running = [subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path), str(k)]) for k in range(2)]
    assert [each.wait(120) for each in running] == [0, 0]
    assert files(tmp_path) == ["key.npz"]


def test_a_process_that_is_killed_as_it_writes_leaves_the_old_entry(tmp_path: Path) -> None:
    Cache(tmp_path).store("mesh", "key", ARRAYS, TABLE)
    code = WRITER.replace("range(60)", "range(10**9)").replace("20000", "2000000")
    running = subprocess.Popen([sys.executable, "-c", code, str(tmp_path), "0"])
    while not list(tmp_path.rglob("*.part")) and running.poll() is None:
        time.sleep(0.01)
    running.kill()
    running.wait(60)
    assert Cache(tmp_path).load("mesh", "key") is not None
    left = list(tmp_path.rglob("*.part"))
    for path in left:
        os.utime(path, (0, 0))
    Cache(tmp_path).prepare()
    assert files(tmp_path) == ["key.npz"]


def test_a_full_disk_is_said_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: io.IOBase, **_: object) -> None:
        file.write(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(InputError, match="cannot keep results here \\(No space left on device\\); free"):
        Cache(tmp_path).store("mesh", "key", ARRAYS, TABLE)
    assert files(tmp_path) == []
