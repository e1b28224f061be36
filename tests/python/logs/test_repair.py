"""All faults of a log at once, and what is left out of it: never more is known than without a repair."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from elliptude import logs
from elliptude.configuration.configuration import Configuration
from elliptude.io.files import FileError
from elliptude.logs.log import faults_of, joined
from elliptude.logs.order_of_rows import out_of_order
from elliptude.logs.repaired import row_in_file

H = 0.01
HEADER = "t;gx;gy;gz;ax;ay;az"


def configured(*, repair=True, **changes):
    return Configuration.model_validate(
        {
            "time_column": "t",
            "reference_frame": "ENU",
            "flow": {"kind": "gyro", "columns": ["gx", "gy", "gz"], "noise_deg_per_s": 1.0},
            "directions": [
                {"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "g", "bound_deg": 1.0}
            ],
            "estimator": {"mode": "guaranteed"},
            "timing": {"repair": repair},
        }
        | changes
    )


def row(t, i, up="0;0;1"):
    return f"{t:.6g};{i};0,5;0;{up}".replace(".", ",")


def clean(count=40):
    return [row(H * i, i) for i in range(count)]


def write(tmp_path, rows):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    return path


def faults(path, configuration):
    return {fault.what: (fault.count, fault.places) for fault in faults_of(path, configuration).faults}


def test_a_clean_log_is_the_same_with_a_repair(tmp_path):
    path = write(tmp_path, clean())
    plain, repaired = (logs.read_log(path, configured(repair=repair)) for repair in (False, True))
    assert faults_of(path, configured()).faults == []
    for name in ("times", "rates", "directions", "rows"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(repaired, name))


def test_one_sample_at_fault_is_left_out_where_no_cell_is_empty(tmp_path):
    rows = clean()
    rows[17] = row(0.17, 17, "0;0;0")
    log = logs.read_log(write(tmp_path, rows), configured())
    assert len(log.times) == len(rows)
    assert np.flatnonzero(np.isnan(log.directions[:, 0]).all(axis=1)).tolist() == [17]


def test_every_kind_of_fault_is_listed_at_once_and_left_out(tmp_path):
    rows = clean()
    rows[5] = f"{0.05:.6g};NaN;NaN;NaN;NaN;NaN;NaN".replace("0.", "0,")
    rows[8] = row(0.08, "", "0;0;1").replace(";0,5;0;", ";;;")
    rows[11] = row(0.11, 11, "0;;1")
    rows[14] = row(0.14, 14, "0;1e300;1")
    rows[17] = row(0.17, 17, "0;0;0")
    rows[19] = row(0.19, "inf")
    rows[22] = row(7.7, 22)
    rows[25] = ";25;0,5;0;0;0;1"
    rows[27] += ";9"
    rows.insert(30, rows[29])
    rows.insert(33, rows[32].replace(";31;", ";99;"))
    path = write(tmp_path, rows)
    assert faults(path, configured()) == {
        "lines without the 7 columns of the header": (1, ("line 29",)),
        "lines with words such as NaN or null": (1, ("line 7",)),
        "rows without a time in 't'": (1, ("line 27",)),
        "rows whose time in 't' is after that of rows below": (1, ("line 24",)),
        "rows that repeat the row above": (1, ("line 32",)),
        "samples of the gyro that are infinite": (1, ("line 21",)),
        "rows without the gyro": (2, ("line 7", "line 10")),
        "samples of the gyro that differ at the same time": (2, ("line 34", "line 35")),
        "samples of up with empty components": (1, ("line 13",)),
        "samples of up beyond 1e+30": (1, ("line 16",)),
        "samples of up that are zero": (1, ("line 19",)),
    }
    with pytest.raises(FileError) as caught:
        logs.read_log(path, configured(repair=False))
    for what in faults(path, configured()):
        assert f"{what}: " in str(caught.value)
    assert "--repair leaves them out" in str(caught.value)

    log = logs.read_log(path, configured())
    # What is measured is what the file says at that time, and nothing is put where something was left out.
    np.testing.assert_array_equal(np.diff(log.times) > 0.0, True)
    number = np.rint(log.times / H).astype(int)
    sampled = np.isin(log.times, log.gyro_times)
    np.testing.assert_array_equal(log.rates[sampled, 0], number[sampled])
    assert set(range(40)) - set(number[sampled]) == {5, 8, 19, 22, 25, 27, 31}
    assert set(number[np.isnan(log.directions[:, 0, 0])]) == {5, 11, 14, 17}
    # A place is that of the file.
    assert log.place(int(np.argmax(number == 39))).startswith("line 43")


@pytest.mark.parametrize("batch_bytes", [256, 1 << 22])
@pytest.mark.parametrize(
    ("encoding", "written"),
    [("utf-8", "{}"), ("utf-8", "{}  "), ("utf-8", "{}\r"), ("utf-8", "\ufeff{}"), ("utf-16", "{}"), ("latin-1", "{}")],
)
def test_a_header_that_stands_again(tmp_path, monkeypatch, encoding, written, batch_bytes):
    """As where a logger went on in the same file: nothing is lost, and places are those of the file."""
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", batch_bytes)
    monkeypatch.setattr("elliptude.io.readers.text.translated._CHUNK", batch_bytes // 4)
    header, rows = "t;gx;gy;gz;ax;ay;az;°", [f"{line};1" for line in clean()]
    again = [*rows[:12], *[written.format(header)] * 2, *rows[12:], header]
    path = tmp_path / "log.csv"
    for lines, repeated in ((rows, None), (again, (3, ("line 14", "line 15", "line 44")))):
        path.write_bytes(("\n".join([header, *lines]) + "\n").encode(encoding))
        assert faults(path, configured()).get("lines that repeat the header") == repeated
        log = logs.read_log(path, configured())
        np.testing.assert_allclose(log.times, H * np.arange(40), atol=1e-12)
        assert log.place(39).startswith("line 43" if repeated else "line 41")


def test_a_header_and_its_units_that_stand_again(tmp_path):
    header, unit = "t gx gy gz ax ay az", "s  dps dps dps g g g"
    rows = [line.replace(";", "  ").replace(",", ".") for line in clean()]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, unit, *rows[:20], header, unit, *rows[20:]]) + "\n")
    assert faults(path, configured()) == {"lines that repeat the header": (2, ("line 23", "line 24"))}
    assert len(logs.read_log(path, configured()).times) == 40
    with pytest.raises(FileError, match=r"line 23: the header again: .* --repair leaves them out"):
        logs.read_log(path, configured(repair=False))


def test_what_is_left_out_of_the_gyro_is_a_gap(tmp_path):
    from elliptude.estimation import gaps

    rows = clean()
    rows[20] = row(H * 20, "NaN").replace(";0,5;0;", ";NaN;NaN;")
    log = logs.read_log(write(tmp_path, rows), configured())
    longest = gaps.longest_interval(log, configured())
    np.testing.assert_allclose(np.flatnonzero(np.diff(log.gyro_times) > longest), [19])
    without = gaps.without_rates_in_gaps(log, longest)
    assert np.isnan(without.rates[20]).all()


@pytest.mark.parametrize("step", [0.2, 0.03, 0.015])
def test_a_clock_that_was_set_back_is_not_repaired(tmp_path, step):
    rows = clean() + [row(H * 39 - step + H * i, i + 100) for i in range(1, 40)]
    path = write(tmp_path, rows)
    for repair in (True, False):
        with pytest.raises(FileError, match=r"line 42, column 1 \(t\): the clock was set back here") as raised:
            logs.read_log(path, configured(repair=repair))
        assert "timing.backward" not in str(raised.value)  # it would not mend it either


@pytest.mark.parametrize("size", [2.0**16, 2.0**32 * 1e-6])
def test_a_counter_that_begins_anew_is_named(tmp_path, size):
    """In 16 bits of a second, or in 32 of a microsecond: what to add is said."""
    begin = size - 1.0
    rows = [f"{(begin + H * i) % size:.6f};{i};0,5;0;0;0;1".replace(".", ",") for i in range(180)]
    path = write(tmp_path, rows)
    said = rf"line 102, .* the clock begins anew here, as a counter does after {size:.10g}\. Add that to all times"
    with pytest.raises(FileError, match=said):
        logs.read_log(path, configured(repair=True))


def order(times, marks=None):
    marks = np.arange(len(times), dtype=np.uint64) if marks is None else np.array(marks, dtype=np.uint64)
    return tuple(part.tolist() for part in out_of_order(np.array(times), marks[:, None]))


def test_rowsout_of_order():
    regular = [1.0 + H * i for i in range(50)]
    assert order(regular) == ([], [], [])

    def changed(changes):
        return [changes.get(i, time) for i, time in enumerate(regular)]

    assert order(changed({20: 0.5})) == ([20], [], [])
    assert order(changed({20: 99.0})) == ([], [20], [])
    assert order(changed({0: 99.0})) == ([], [0], [])
    assert order(changed({49: 0.1})) == ([49], [], [])
    assert order(changed({20: regular[21], 21: regular[20]})) == ([21], [], [])
    again = regular + regular[20:23] + [1.0 + H * (50 + i) for i in range(5)]
    assert order(again, [*range(50), 20, 21, 22, *range(60, 65)]) == ([50, 51, 52], [], [])
    # Those rows with other values: the clock was set back.
    assert order(again)[2] == [50]
    assert order(regular + [time - 0.3 for time in regular])[2] == [50]


def test_a_quote_that_stays_open_is_not_repaired(tmp_path):
    """As one broken line it would take all lines below it along."""
    rows = clean()
    rows[7] = rows[7].replace("0,5", '"0,5')
    with pytest.raises(FileError, match="line 9: text in quotes that goes on to line 41, and leaves 3 columns of 7"):
        logs.read_log(write(tmp_path, rows), configured())


def test_a_clock_that_was_set_back_beside_a_pause():
    """There is room for the rows, but for many more: the stamps on both sides may be of different clocks."""
    regular = [1.0 + H * i for i in range(50)]
    last = regular[-1]
    # 5 s without rows, one row, and the clock is set back by 3 s: of 5 s the others would show 2.
    first_row_late = [last + 5.0, *(last + 2.0 + H * i for i in range(1, 50))]
    assert order(regular + first_row_late) == ([], [], [51])
    # Set back by half a second, three rows, and 5 s without any.
    before_a_pause = [*(last - 0.4963 + H * i for i in range(1, 4)), *(last + 4.5 + H * i for i in range(50))]
    assert order(regular + before_a_pause) == ([], [], [50])
    # One more row that is lost is no pause.
    lost = [*regular[:20], 99.0, *regular[22:]]
    assert order(lost) == ([], [20], [])
    lost = [*regular[:20], 0.5, *regular[22:]]
    assert order(lost) == ([20], [], [])


def test_rows_in_the_file():
    left_out = np.array([2, 3, 7])
    assert [row_in_file(left_out, row) for row in range(7)] == [0, 1, 4, 5, 6, 8, 9]


def test_parquet_nan_and_batches(tmp_path, monkeypatch):
    count = 1000
    columns = {name: np.ones(count) for name in ("gx", "gy", "gz", "ax", "ay", "az")}
    columns["gx"][[10, 700]] = np.nan
    stamps = H * np.arange(count)
    stamps[500] = stamps[499]
    pa.parquet.write_table(pa.table({"t": stamps, **columns}), tmp_path / "log.parquet")
    monkeypatch.setattr("elliptude.io.readers.parquet.BATCH_ROWS", 64)
    path = tmp_path / "log.parquet"
    assert faults(path, configured()) == {
        "rows that repeat the row above": (1, ("row 501",)),
        "samples of the gyro with NaN": (2, ("row 11", "row 701")),
    }
    log = joined(list(logs.read_pieces(path, configured())))
    assert len(log.times) == count - 1
    assert len(log.gyro_times) == count - 3


# --- torques ----------------------------------------------------------------------------------------------------------


def of_body(*, mode="guaranteed", columns="control_torque_columns", **timing):
    flow = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 2.0, 2.5], "step_s": 0.01, columns: ["gx", "gy", "gz"]}
    start = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1.0] * 6}
    return configured(flow=flow, timing=timing, estimator={"mode": mode}, start=start)


def lost(rows):
    """A log with a fault in some rows, and the places that a message names."""
    changed = clean()
    for k, written in rows.items():
        changed[k] = written
    return changed


LOST_TORQUES = [
    ({17: "0,17;NaN;NaN;NaN;0;0;1"}, r"rows without \w+ \w+ \w+: 1 \(line 19\)"),
    ({17: "0,17;;;;0;0;1"}, r"rows without .*: 1 \(line 19\)"),
    ({17: row(0.17, 17).replace("0,5", "1e40")}, r"samples of .* that are left out: 1 \(line 19\)"),
    ({17: row(0.17, 17).replace("0,5", "")}, r"samples of .* that are left out: 1 \(line 19\)"),
    ({17: row(1e9, 17), 28: row(0.005, 28)}, r"rows with .* that are left out: 2 \(line 19, line 30\)"),
    ({17: row(0.17, 17).replace("0,17", "NaN")}, r"rows with .* that are left out: 1 \(line 19\)"),
    ({17: "0,17;1"}, r"lines without the 7 columns of the header: 1 \(line 19\)"),
    ({17: row(0.16, 17)}, r"samples of .* that are left out: 2 \(line 18, line 19\)"),
]


@pytest.mark.parametrize("columns", ["control_torque_columns", "wheel_momentum_columns"])
@pytest.mark.parametrize(("rows", "places"), LOST_TORQUES)
def test_a_torque_that_is_lost_is_not_the_next_one(tmp_path, rows, places, columns):
    path = write(tmp_path, lost(rows))
    name = "the control torque" if columns.startswith("control") else "the wheel momentum"
    why = rf"a repair does not go with a control torque or a wheel's momentum .*: .*{places}.* is then unknown"
    with pytest.raises(FileError, match=why) as caught:
        logs.read_log(path, of_body(repair=True, columns=columns))
    assert name in str(caught.value) or "lines without" in str(caught.value)
    # The modes of first order promise nothing.
    logs.read_log(path, of_body(repair=True, mode="first_order", columns=columns))


def test_a_repair_that_loses_no_torque(tmp_path):
    rows = clean()
    rows[17] = row(0.17, 17, "0;0;0")
    rows.insert(30, rows[29])
    rows.insert(12, HEADER)
    log = logs.read_log(write(tmp_path, rows), of_body(repair=True))
    assert len(log.times) == 40
    np.testing.assert_array_equal(log.control_torques[:, 0], np.arange(40))


def test_a_row_that_is_dropped_loses_its_torque(tmp_path):
    path = write(tmp_path, lost({17: row(0.18, 18), 18: row(0.17, 17)}))
    with pytest.raises(FileError, match=r"timing.backward = 'drop' does not go with .*: 1 \(line 20\)"):
        logs.read_log(path, of_body(backward="drop"))
    assert len(logs.read_log(path, of_body(backward="drop", mode="first_order")).times) == 39


@pytest.mark.parametrize("repair", [False, True])
def test_an_empty_torque_is_a_statement_of_the_next_one(tmp_path, repair):
    """It acts since the torque before it: over rows of other sensors in between, too."""
    path = write(tmp_path, lost({k: f"{H * k:.6g};;;;0;0;1".replace(".", ",") for k in (17, 18)}))
    log = logs.read_log(path, of_body(repair=repair, largest_gap_s=0.05))
    np.testing.assert_array_equal(log.control_torques[15:21, 0], [15.0, 16.0, 19.0, 19.0, 19.0, 20.0])
    with pytest.raises(FileError, match=r"0\.03 s after the sample of the control torque before it, more than"):
        logs.read_log(path, of_body(repair=repair, largest_gap_s=0.025))
    with pytest.raises(FileError, match=r"rows without the control torque: 2") as caught:
        logs.read_log(path, of_body(repair=repair))
    assert "--repair" not in str(caught.value), "which would be refused"


def test_a_stamp_far_ahead_between_short_steps():
    """The rows behind it go on from the one before it: a short step and a usual one are room enough."""
    times = [1.0 + H * i for i in range(50)]
    times[21:] = [time - 0.3 * H for time in times[21:]]
    for far in (1.9, 100.0, 1e9, 1e300):
        assert order([*times[:20], far, *times[21:]]) == ([], [20], [])
    # Not so if it is no more than a few steps ahead, or if the rows behind it leave no room for it.
    assert order([*times[:20], times[21] + 0.5 * H, *times[21:]])[1] == []
    assert order([*times[:20], 100.0, *(time - 0.5 * H for time in times[21:])]) == ([], [], [21])
    # A row was lost, and the clock was set back by little more than a step.
    assert order([*times[:20], times[20] + H, *(time + 0.6 * H for time in times[21:])])[1] == []


@pytest.mark.parametrize("far", ["100.2", "1e9", "1e300"])
def test_one_stamp_far_ahead_is_named_and_its_row_alone_left_out(tmp_path, far):
    rows = clean()
    rows[20] = ";".join([far.replace(".", ","), *rows[20].split(";")[1:]])
    rows[21:] = [row(H * (i - 0.3), i) for i in range(21, 40)]
    path = write(tmp_path, rows)
    for backward in ("refuse", "drop"):
        with pytest.raises(FileError, match=r"log.csv: line 22, column 1 \(t\): ") as raised:
            logs.read_log(path, configured(timing={"backward": backward}))
        assert "line 23" not in str(raised.value)
        assert "--repair leaves" in str(raised.value)
        assert "Cut the file" not in str(raised.value)
    log = logs.read_log(path, configured())
    kept = [i for i in range(40) if i != 20]
    np.testing.assert_allclose(log.times, [H * (i - 0.3 * (i > 20)) for i in kept], atol=1e-12)
    np.testing.assert_array_equal(log.rates[:, 0], kept)
