"""The disk cache of embeddings: kept exactly, shared by processes, and never in the way."""

from __future__ import annotations

import logging
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import DependencyError
from morphkit.utils.cache_dir import cache_dir
from morphkit_rl.text.cache import _TABLE, EmbeddingCache
from morphkit_rl.text.encoder import TextEncoder
from tests.support.networks import TEXTS


def test_cache_folder_follows_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MORPHKIT_CACHE", str(tmp_path))
    assert EmbeddingCache("m", 2).file.parent == tmp_path
    monkeypatch.delenv("MORPHKIT_CACHE")
    assert cache_dir().name == "morphkit"


def test_a_user_without_a_home_goes_without_a_cache(
    tiny_bert: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def unknown(_: int) -> None:
        raise KeyError("uid not found")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pwd.getpwuid", unknown)
    for name in ("HOME", "MORPHKIT_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert TextEncoder(str(tiny_bert)).encode(TEXTS).shape == (4, 8)
    assert "MORPHKIT_CACHE" in caplog.text
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("MORPHKIT_CACHE", "~nobody-of-that-name/cache")
    assert TextEncoder(str(tiny_bert)).encode(TEXTS).shape == (4, 8)
    with pytest.raises(DependencyError, match="no such folder"):
        TextEncoder("~nobody-of-that-name/model")
    assert list(tmp_path.iterdir()) == []


def test_cache_keeps_vectors_exactly(tmp_path: Path) -> None:
    cache = EmbeddingCache("m", 3, tmp_path)
    assert cache.get(["a"]) == {}
    cache.put({"a": np.array([1, 1e-30, np.pi], np.float32), "ü 'x'": np.zeros(3, np.float32)})
    again = EmbeddingCache("m", 3, tmp_path).get(["a", "b", "ü 'x'"])
    assert sorted(again) == ["a", "ü 'x'"]
    np.testing.assert_array_equal(again["a"], np.array([1, 1e-30, np.pi], np.float32))


def test_what_is_kept_first_counts_for_all_processes(tmp_path: Path) -> None:
    first, other = (np.array([1, value], np.float32) for value in (0.5, 0.5000001))
    assert not np.array_equal(first, other)
    EmbeddingCache("m", 2, tmp_path).put({"a": first})
    late = EmbeddingCache("m", 2, tmp_path).put({"b": other, "a": other})
    found = EmbeddingCache("m", 2, tmp_path).get(["a", "b"])
    for vectors in (late, found):
        np.testing.assert_array_equal(vectors["a"], first)
        np.testing.assert_array_equal(vectors["b"], other)


def test_what_is_kept_but_damaged_is_replaced(tmp_path: Path) -> None:
    cache, vector = EmbeddingCache("m", 2, tmp_path), np.ones(2, np.float32)
    cache.put({"a": vector})
    with closing(sqlite3.connect(cache.file)) as connection, connection:
        connection.execute("UPDATE embeddings SET crc = crc + 1")
    assert cache.get(["a"]) == {}
    assert list(cache.put({"a": 2 * vector})) == ["a"]
    np.testing.assert_array_equal(cache.get(["a"])["a"], 2 * vector)


def test_an_encoder_uses_what_another_process_kept_meanwhile(
    tiny_bert: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoder = TextEncoder(str(tiny_bert), cache_dir=tmp_path)
    monkeypatch.setattr(encoder._cache, "get", lambda _: {})
    kept = np.arange(8, dtype=np.float32)
    EmbeddingCache(f"{encoder.source.identity}-{encoder.pooling}", 8, tmp_path).put({TEXTS[0]: kept})
    np.testing.assert_array_equal(encoder.encode(TEXTS)[0], kept)


@pytest.mark.parametrize("damage", ["garbage", "cut", "other table", "zeros"])
def test_a_damaged_cache_is_built_anew(
    damage: str, tiny_bert: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = TextEncoder(str(tiny_bert), cache_dir=tmp_path)
    expected = first.encode(TEXTS)
    file = first._cache.file
    content = file.read_bytes()
    if damage == "garbage":
        file.write_bytes(b"not a database" * 100)
    elif damage == "cut":
        file.write_bytes(content[: len(content) // 2])
    elif damage == "zeros":
        file.write_bytes(content[:100] + bytes(len(content) - 100))
    else:
        file.unlink()
        connection = sqlite3.connect(file)
        connection.execute("CREATE TABLE embeddings (word TEXT)")
        connection.close()
    np.testing.assert_array_equal(TextEncoder(str(tiny_bert), cache_dir=tmp_path).encode(TEXTS), expected)
    assert "was damaged" in caplog.text
    assert len(EmbeddingCache(file.name.removesuffix("-v1.sqlite3"), 8, tmp_path).get(TEXTS)) == len(TEXTS)


def test_a_file_that_another_process_is_making_is_no_damaged_one(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cache = EmbeddingCache("m", 2, tmp_path)
    with closing(sqlite3.connect(cache.file, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        other.execute(_TABLE)
        assert cache.get(["a"]) == {}
        other.execute("INSERT INTO embeddings VALUES ('a', ?, ?)", cache._pack("a", np.ones(2, np.float32)))
        assert cache.get(["a"]) == {}
        other.execute("COMMIT")
    assert cache.get(["a"])["a"].tolist() == [1, 1]
    assert caplog.text == ""


def test_a_changed_byte_in_a_vector_is_noticed(tmp_path: Path) -> None:
    cache = EmbeddingCache("m", 4, tmp_path)
    vector = np.array([1.25, 2.5, 3.75, 5], np.float32)
    cache.put({"a": vector})
    content = cache.file.read_bytes()
    assert content.count(vector.tobytes()) == 1
    cache.file.write_bytes(content.replace(vector.tobytes(), (vector + 1).tobytes()))
    assert cache.get(["a"]) == {}


def test_a_folder_that_cannot_be_made_costs_one_warning(
    tiny_bert: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    encoder = TextEncoder(str(tiny_bert), cache_dir=tmp_path / "file" / "cache")
    assert encoder.encode(TEXTS[:2]).shape == (2, 8)
    assert encoder.encode(TEXTS).shape == (4, 8)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "MORPHKIT_CACHE" in caplog.text


def test_a_full_disk_costs_one_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    cache = EmbeddingCache("m", 2, tmp_path)
    cache.put({"a": np.ones(2, np.float32)})
    connection = sqlite3.connect(cache.file)
    pages = connection.execute("PRAGMA page_count").fetchone()[0]
    connection.close()
    connect = sqlite3.connect

    def full(*arguments: object, **options: object) -> sqlite3.Connection:
        opened: sqlite3.Connection = connect(*arguments, **options)  # type: ignore[call-overload]
        opened.execute(f"PRAGMA max_page_count = {pages}")
        return opened

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", full)
        cache.put({f"text {index}": np.ones(2, np.float32) for index in range(2000)})
    assert "disk is full" in caplog.text
    assert list(cache.get(["a", "text 0"])) == ["a"]


def test_many_writers_at_once_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("morphkit_rl.text.cache._BUSY_S", 300.0)  # However slow the disk is, nobody is to give up.

    def write(worker: int) -> None:
        for index in range(5):
            EmbeddingCache("m", 2, tmp_path).put({f"{worker} {index}": np.array([worker, index], np.float32)})

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(8)))
    names = [f"{worker} {index}" for worker in range(8) for index in range(5)]
    found = EmbeddingCache("m", 2, tmp_path).get(names)
    assert {name: found[name].tolist() for name in names} == {
        f"{worker} {index}": [worker, index] for worker in range(8) for index in range(5)
    }
