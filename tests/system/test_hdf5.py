"""What is looked for in files of others before their data are taken, in this process."""

import json
import resource

import h5py
import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.system import hdf5


@pytest.fixture(autouse=True)
def limits(monkeypatch) -> list:
    """Limits of processor time that are set, which no process could raise again."""
    found: list = []
    monkeypatch.setattr(resource, "setrlimit", lambda *given: found.append(given))
    return found


def size(path) -> int:
    return path.stat().st_size


def test_data_in_a_file_are_handed_to_the_work(tmp_path, limits):
    path = tmp_path / "good.h5"
    with h5py.File(path, "w") as file:
        file["a/b"] = np.arange(100.0)
    assert hdf5._checked(path, 7, lambda path, more: (path.name, more), 3) == ("good.h5", 3)
    ((what, (soft, hard)),) = limits
    assert what == resource.RLIMIT_CPU and soft == 7 and hard == 8


@pytest.mark.parametrize(
    ("most", "expected"),
    [(resource.RLIM_INFINITY, (7, 8)), (100, (7, 8)), (7, (7, 7)), (5, (5, 5))],
)
def test_a_limit_that_there_is_stays(tmp_path, limits, monkeypatch, most, expected):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (most, most))
    assert hdf5._checked(tmp_path / "none.h5", 7, size_or_none) is None
    assert [given[1] for given in limits] == [expected]


def size_or_none(path):
    return path.stat().st_size if path.exists() else None


def test_data_that_lie_elsewhere_are_refused(tmp_path):
    """Virtual and external datasets, and links to other files, at any depth; links within a file are none of these."""
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(3)

    def external(file) -> None:
        file.create_dataset("g/y", (3,), "f8", external=[(str(tmp_path / "raw"), 0, 24)])

    def virtual(file) -> None:
        layout = h5py.VirtualLayout((3,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (3,))
        file.create_virtual_dataset("g/y", layout)

    def link(file) -> None:
        file["g/z"] = np.zeros(2)
        file["g/y"] = h5py.ExternalLink("other.h5", "/x")

    def link_at_the_top(file) -> None:
        file["y"] = h5py.ExternalLink("other.h5", "/x")

    for k, make in enumerate((external, virtual, link, link_at_the_top)):
        path = tmp_path / f"{k}.h5"
        with h5py.File(path, "w") as file:
            make(file)
        with pytest.raises(InputError, match="its data lie in other files"):
            hdf5._checked(path, 1, size)
    path = tmp_path / "soft.h5"
    with h5py.File(path, "w") as file:
        file["g/z"] = np.zeros(2)
        file["g/y"] = h5py.SoftLink("/g/z")
    assert hdf5._checked(path, 1, size) == size(path)


def test_arrays_that_no_compression_explains_are_refused(tmp_path):
    """Datasets without data may be as large as they say; zeros that are compressed are fine."""
    path = tmp_path / "large.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (10**7,), "f8", chunks=(10**5,))
        file.create_dataset("b", (10**7,), "f8", chunks=(10**5,))
    with pytest.raises(InputError, match=rf"arrays of 1.6e\+08 bytes in {size(path)}"):
        hdf5._checked(path, 1, size)
    with h5py.File(path, "w") as file:
        file.create_dataset("a", data=np.zeros(10**6), compression="gzip")
    assert 100 * size(path) < 8 * 10**6
    assert hdf5._checked(path, 1, size) == size(path)


def test_a_file_of_another_kind_is_left_to_its_reader(tmp_path):
    path = tmp_path / "text.h5"
    path.write_text("no such file", encoding="utf-8")
    assert hdf5._checked(path, 1, size) == 12


def test_a_file_is_a_tree(tmp_path):
    """Groups as tables, words as what JSON has, arrays, and arrays that are several in one."""
    path = tmp_path / "tree.h5"
    with h5py.File(path, "w") as file:
        file["a/words"] = json.dumps({"k": [1, 2]})
        file["a/array"] = np.arange(6).reshape(2, 3)
        file["parts"] = np.arange(5.0)
        file["parts"].attrs["ends"] = [2, 2, 5]
    found = hdf5.read_tree(path)
    assert found["a"]["words"] == {"k": [1, 2]}
    assert found["a"]["array"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert [part.tolist() for part in found["parts"]] == [[0.0, 1.0], [], [2.0, 3.0, 4.0]]
    with pytest.raises(InputError, match="FileNotFoundError"):
        hdf5.read_tree(tmp_path / "none.h5")


def test_the_time_of_a_file_grows_with_its_bytes(tmp_path, monkeypatch):
    given = []

    def apart(folder, checked, path, seconds, work, *more):
        given.append((checked, path, seconds, work, more))
        return "answer"

    monkeypatch.setattr(hdf5, "apart", apart)
    path = tmp_path / "file"
    path.write_bytes(bytes(3_500_000))
    assert hdf5.read_apart(path, size, "label: ", 1, 2) == "answer"
    assert given == [(hdf5._checked, path.resolve(), 13, size, (1, 2))]
    hdf5.read_apart(tmp_path / "none", size, "label: ")
    assert given[1][2] == 10
    with pytest.raises(InputError, match=r"^label: it is no file"):
        hdf5.read_apart(tmp_path, size, "label: ")
    for error, words in (
        (ChildProcessError("SIGXCPU"), "takes more than 13 s of processor time"),
        (ChildProcessError("SIGSEGV"), r"ends the process \(SIGSEGV\)"),
    ):
        monkeypatch.setattr(hdf5, "apart", lambda *_, error=error: (_ for _ in ()).throw(error))
        with pytest.raises(InputError, match=f"^label: reading it {words}"):
            hdf5.read_apart(path, size, "label: ")
    assert hdf5.probe(tmp_path / "none") is None
    with pytest.raises(InputError, match="not a complete folder of results: reading it ends"):
        hdf5.probe(path)
