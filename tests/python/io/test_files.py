"""Files that are written whole or not at all, whatever the moment at which the program is interrupted."""

import subprocess
import sys
import textwrap

import pytest
from elliptude.io import files

PROGRAM = """
    import sys
    from pathlib import Path
    from elliptude.io import files

    target, kept, interrupted = Path(sys.argv[1]), [], 0
    sys.kept = kept  # so that no interrupt's frames, and no generator in them, end before the program


    def write():
        with files.replacing(target) as temporary, temporary.open("w") as file:
            file.write("whole")


    def interrupt(work, after):
        seen = 0

        def trace(frame, event, argument):
            nonlocal seen
            frame.f_trace_opcodes = True
            if event == "opcode":
                seen += 1
                if seen == after:
                    raise KeyboardInterrupt
            return trace

        sys.settrace(trace)
        try:
            work()
        except KeyboardInterrupt as error:
            kept.append(error)
        finally:
            sys.settrace(None)
        return seen >= after


    for work in (write, lambda: files.require_writable(target)):
        after = 1
        while interrupt(work, after):
            if target.exists():
                assert target.read_text() == "whole"
                target.unlink()
            after += 1
            interrupted += 1
        target.unlink(missing_ok=True)
    print(interrupted)
"""


def test_nothing_is_left_wherever_an_interrupt_comes(tmp_path):
    """Before each of the interpreter's instructions, those of the `with` statement's own code among them."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(PROGRAM), str(tmp_path / "file")],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 500
    assert list(tmp_path.iterdir()) == []


def test_a_child_process_does_not_remove_its_parents_files(tmp_path):
    program = """
        import atexit, os, sys
        from elliptude.io import files

        with files.replacing(sys.argv[1]) as temporary:
            temporary.write_text("whole")
            child = os.fork()
            if child == 0:
                atexit._run_exitfuncs()
                os._exit(0)
            os.waitpid(child, 0)
    """
    target = tmp_path / "file"
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), str(target)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert target.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [target]


def test_what_cannot_be_removed_is_no_traceback_at_the_end(tmp_path):
    """The folder of the temporary file is a file."""
    (tmp_path / "file").write_text("")
    program = """
        import sys
        from pathlib import Path
        from elliptude.io import files

        try:
            files.require_writable(Path(sys.argv[1]) / "file" / "out")
        except files.FileError as error:
            print(error)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), str(tmp_path)], capture_output=True, text=True, timeout=300
    )
    assert done.stderr == ""
    assert "within a file, where a folder is needed" in done.stdout


def test_a_trial_leaves_nothing(tmp_path):
    files.require_writable(tmp_path / "new" / "file", makes_folders=True)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(files.FileError, match="it is a folder"):
        files.require_writable(tmp_path)
