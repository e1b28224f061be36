"""Fuzzes the reader of one format by atheris: `fuzz_readers.py FORMAT [libFuzzer's options]`, run by tools/fuzz.py.

tests/python/io/test_fuzz_readers.py tries the kept inputs, and changes of them, without atheris.
"""

import sys
import tempfile
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["elliptude", "pyulog", "reader_oracle"]):
    import reader_oracle


def main() -> None:
    """Until libFuzzer ends."""
    kind = sys.argv.pop(1)
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        atheris.Setup(sys.argv, lambda data: reader_oracle.check(kind, data, Path(folder)))
        atheris.Fuzz()


if __name__ == "__main__":
    main()
