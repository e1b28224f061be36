"""No function that is compiled for one instruction set is linked into code for another."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

OBJECTS = (
    Path(__file__).parents[3] / "build" / "python" / "python" / "bindings" / "CMakeFiles" / "elliptude_kernels.dir"
)


def shared_with_others(instruction_set: str, symbols: str) -> list[str]:
    """The functions that the linker may take from elsewhere, or give to others, and that bear no name of this set."""
    weak = re.findall(r"^[0-9a-f]+ [WVu] (.+)$", symbols, re.MULTILINE)
    return [name for name in weak if f"_{instruction_set}::" not in name and f"_{instruction_set} " not in name]


def test_what_is_shared_is_noticed():
    symbols = "0000000000000000 W elliptude_avx2::cayley(double)\n0000000000000000 W std::max<double>(double)\n"
    assert shared_with_others("avx2", symbols) == ["std::max<double>(double)"]
    assert len(shared_with_others("avx512", symbols)) == 2


@pytest.mark.parametrize("kernel", ["ensemble", "filter"])
@pytest.mark.parametrize("instruction_set", ["baseline", "avx2", "avx512"])
def test_kernels_share_no_function(kernel, instruction_set):
    kernels = list(OBJECTS.rglob(f"{kernel}_kernel_{instruction_set}.cpp.o"))
    if not kernels:
        pytest.skip("the package was not built here")
    if shutil.which("nm") is None:
        pytest.skip("no nm")
    symbols = subprocess.run(["nm", "--demangle", kernels[0]], capture_output=True, text=True, check=True).stdout
    assert f"elliptude_{instruction_set}::" in symbols
    assert shared_with_others(instruction_set, symbols) == []
