"""Recordings from standard input and named pipes: what commands make of them is what they make of the file."""

import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from elliptude.io.files import FileError
from elliptude.io.readers.open import open_log
from elliptude.io.spool import recording
from elliptude.io.tables import Result
from test_proposals import made
from two_commands import HEADER, app, columns_of, dirty, inside, succeed
from typer.testing import CliRunner

PROGRAM = "import sys; sys.argv[0] = 'elliptude'; from elliptude.cli import main; main()"


def run(folder, *arguments, read=None, **more):
    """The command as a process of its own, in a folder that also has its temporary files."""
    (folder / "tmp").mkdir(exist_ok=True)
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    environment = os.environ | {"TMPDIR": str(folder / "tmp")}
    done = subprocess.run(
        command, input=read, cwd=folder, env=environment, capture_output=True, check=False, timeout=300, **more
    )
    assert not list((folder / "tmp").iterdir()), "a temporary file is left"
    return done.returncode, " ".join((done.stdout + done.stderr).decode().split())


def as_csv(recording):
    text = io.StringIO()
    np.savetxt(text, columns_of(recording), fmt="%.9g", delimiter=",", header=",".join(HEADER), comments="")
    return text.getvalue().encode()


def as_parquet(recording):
    sink = io.BytesIO()
    pa.parquet.write_table(pa.table(dict(zip(HEADER, columns_of(recording).T, strict=True))), sink)
    return sink.getvalue()


def as_npz(recording):
    sink = io.BytesIO()
    parts = np.split(columns_of(recording)[:, 1:], 3, axis=1)
    np.savez(sink, t=recording.times, gyr=np.deg2rad(parts[0]), acc=9.80665 * parts[1], mag=parts[2])
    return sink.getvalue()


def results(folder):
    found = Result.read(folder / "results.csv")
    return found.quaternions, found.largest_angles


def test_standard_input_gives_what_the_file_gives(tmp_path):
    """`bounds` reads the log six times, `estimate` again; the truth is in the sets."""
    (tmp_path / "log.csv").write_bytes(as_csv(made()))
    content = (tmp_path / "log.csv").read_bytes()
    code, said = run(tmp_path, "bounds", "-", "--out", "piped.toml", read=content)
    assert code == 0, said
    assert said.startswith("standard input: ")
    assert "elliptude estimate - --config piped.toml" in said
    succeed("bounds", tmp_path / "log.csv", "--out", tmp_path / "file.toml")
    piped, file = ((tmp_path / f"{name}.toml").read_text() for name in ("piped", "file"))
    assert piped.replace("standard input", "log.csv") == file
    code, said = run(tmp_path, "estimate", "-", "--config", "piped.toml", "--out", "piped", read=content)
    assert code == 0, said
    succeed("estimate", tmp_path / "log.csv", "--config", tmp_path / "file.toml", "--out", tmp_path / "file")
    for piped, file in zip(results(tmp_path / "piped"), results(tmp_path / "file"), strict=True):
        np.testing.assert_array_equal(piped, file)
    found = Result.read(tmp_path / "piped" / "results.csv")
    assert np.isfinite(found.largest_angles).mean() > 0.9
    assert inside(found).all()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_a_pipe_of_the_shell(tmp_path):
    (tmp_path / "log.csv").write_bytes(as_csv(made()))
    subprocess.run(["gzip", "-k", "log.csv"], cwd=tmp_path, check=True)
    command = f"{sys.executable} -c {PROGRAM!r} bounds <(zcat log.csv.gz) --out config.toml".replace(PROGRAM, "$P")
    command = command.replace("'$P'", '"$P"')
    done = subprocess.run(
        ["bash", "-c", command],
        env=os.environ | {"P": PROGRAM},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "/dev/fd/" in done.stdout
    assert (tmp_path / "config.toml").is_file()


def test_a_named_pipe(tmp_path):
    recording = made()
    succeed_on_file = tmp_path / "log.csv"
    succeed_on_file.write_bytes(as_csv(recording))
    said = succeed("bounds", succeed_on_file, "--json")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(as_csv(recording),), daemon=True)
    writer.start()
    assert json.loads(succeed("bounds", pipe, "--json")) == json.loads(said) | {"log": str(pipe)}
    writer.join(10.0)
    assert not writer.is_alive()


@pytest.mark.parametrize("format_of", [as_csv, as_parquet, as_npz])
def test_the_format_is_found_from_the_content(tmp_path, format_of):
    log = {as_csv: "log.csv", as_parquet: "log.parquet", as_npz: "log.npz"}[format_of]
    (tmp_path / log).write_bytes(format_of(made()))
    options = ["--like", "broad"] if format_of is as_npz else []
    expected = json.loads(succeed("bounds", tmp_path / log, *options, "--json"))
    done = CliRunner().invoke(app(), ["bounds", "-", *options, "--json"], input=(tmp_path / log).read_bytes())
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == expected | {"log": "standard input"}


def test_an_archive_that_has_arrays_beside_its_files_is_none_of_numpy(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("Gyroscope.csv", "t,x\n0,1\n")
        archive.writestr("spectrum.npy", "something")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    content = (tmp_path / "a.zip").read_bytes()
    writer = threading.Thread(target=pipe.write_bytes, args=(content,), daemon=True)
    writer.start()
    assert open_log(recording(pipe)).columns == ("Gyroscope.t", "Gyroscope.x")


@pytest.mark.parametrize("packer", ["gzip", "bzip2", "zstd"])
def test_compressed_text_from_standard_input(tmp_path, packer):
    if shutil.which(packer) is None:
        pytest.skip(f"no {packer}")
    text = as_csv(made())
    packed = subprocess.run([packer, "-c"], input=text, capture_output=True, check=True).stdout
    code, said = run(tmp_path, "convert", "-", "out.csv", read=packed)
    assert code == 0, said
    assert (tmp_path / "out.csv").read_text().count("\n") == text.count(b"\n")


def test_check_and_a_repair_read_it_again_and_again(tmp_path):
    """A fault's line is found by another reading, and all faults by one more."""
    text = dirty(made()).encode()
    code, said = run(tmp_path, "bounds", "-", "--repair", "--out", "config.toml", read=text)
    assert code == 0, said
    code, said = run(tmp_path, "check", "-", "config.toml", read=text)
    assert code == 0, said
    assert "rows that repeat the row above: 2 (line" in said
    config = tmp_path / "strict.toml"
    config.write_text((tmp_path / "config.toml").read_text().replace("repair = true", "repair = false"))
    code, said = run(tmp_path, "estimate", "-", "--config", config, "--out", "result", read=text)
    assert code == 1
    assert "standard input: line " in said
    assert "In all: " in said
    assert "elliptude-" not in said, "the temporary file is nobody's business"


def test_what_cannot_be_read_from_a_pipe(tmp_path):
    assert run(tmp_path, "bounds", "-", read=b"") == (1, "error: standard input: empty, not even a header")
    code, said = run(tmp_path, "bounds", "-", "--like", "broad", read=b"PK\x03\x04 no archive")
    assert code == 1
    assert said.startswith("error: standard input: ")
    code, said = run(tmp_path, "bounds", "-", read=b"PAR1 no Parquet")
    assert (code, said) == (1, "error: standard input: not a Parquet file, or damaged")
    code, said = run(tmp_path, "monitor", "-", "--estimate", "-", read=b"")
    assert code == 2
    assert "only one of LOG and --estimate can be a pipe" in said


def test_a_terminal_is_no_recording():
    import pexpect

    child = pexpect.spawn(sys.executable, ["-c", PROGRAM, "bounds", "-"], encoding="utf-8", timeout=300)
    child.expect("error: standard input is a terminal")
    child.expect(pexpect.EOF)


def test_standard_input_that_is_closed(monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(FileError, match="standard input is closed"):
        os.fspath(recording(Path("-")))


def test_no_room_for_the_copy(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    done = CliRunner().invoke(app(), ["bounds", "-"], input=b"t,gx\n0,1\n")
    assert done.exit_code == 1
    assert "no folder to keep it in: no such file or folder; TMPDIR names another" in " ".join(done.output.split())


def test_a_file_that_is_called_like_standard_input(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("-").write_bytes(as_csv(made()))
    assert json.loads(succeed("bounds", tmp_path / "-", "--json"))["log"] == str(tmp_path / "-")
