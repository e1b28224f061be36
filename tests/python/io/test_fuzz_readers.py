"""What the fuzzer of the readers found once, and inputs changed a little, tried in every run."""

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "fuzz"))
import reader_oracle

CORPUS = Path(__file__).parents[2] / "fuzz" / "corpus"


def kept(kind):
    lines = (CORPUS / f"readers_{kind}.txt").read_text().splitlines()
    return [bytes.fromhex(line.partition("#")[0]) for line in lines if line.partition("#")[0].strip()]


def changed(data, random_):
    """Some bytes replaced, repeated, left out, or cut off."""
    data = bytearray(data)
    for _ in range(random_.choice([1, 1, 2, 5])):
        at = random_.randrange(len(data) + 1)
        match random_.randrange(5):
            case 0:
                data[at : at + 1] = bytes([random_.choice([0, 10, 34, 44, 45, 48, 57, 127, 255])])
            case 1:
                data[at : at + 1] = random_.randbytes(1)
            case 2:
                del data[at : at + random_.randrange(1, 9)]
            case 3:
                length = random_.randrange(1, 40)
                data[at:at] = data[at : at + length]
            case _:
                del data[at:]
    return bytes(data)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", reader_oracle.SUFFIXES)
def test_inputs_that_were_kept(kind, tmp_path):
    if kind == "ulog":
        pytest.importorskip("pyulog")
    inputs = kept(kind)
    assert len(inputs) >= 3
    for data in inputs:
        reader_oracle.check(kind, data, tmp_path)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", reader_oracle.SUFFIXES)
def test_inputs_changed_a_little(kind, tmp_path):
    if kind == "ulog":
        pytest.importorskip("pyulog")
    random_ = random.Random(12)
    inputs = kept(kind)
    for _ in range(150):
        reader_oracle.check(kind, changed(random_.choice(inputs), random_), tmp_path)


def test_the_oracle_sees_what_is_wrong(tmp_path, monkeypatch):
    """An exception that is no `FileError` comes out, and a message that names no file is refused."""

    def fails(path):
        raise KeyError("a mistake")

    monkeypatch.setattr(reader_oracle, "open_log", fails)
    with pytest.raises(KeyError):
        reader_oracle.check("csv", b"t\n1\n", tmp_path)

    def is_vague(path):
        raise reader_oracle.FileError("something is wrong")

    monkeypatch.setattr(reader_oracle, "open_log", is_vague)
    with pytest.raises(reader_oracle.OracleBroken, match="names no file"):
        reader_oracle.check("csv", b"t\n1\n", tmp_path)
