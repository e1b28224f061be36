"""From a file to a log in time order: units, axes, delays, rates, gaps, and what is refused with its place."""

import itertools

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import recorders
from elliptude.configuration import Configuration, references, sun
from elliptude.configuration.statements import RestPhase, SunByTime, WorldModel
from elliptude.io.files import FileError
from elliptude.io.readers.text import csv as csv_files
from elliptude.logs import log as logs
from elliptude.logs.alignment.rows import _begin_rows
from elliptude.simulation import fermi
from elliptude.validation.recordings.truth.earths_field import _slope, field_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

START = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [0.1] * 6}
GYRO = {"kind": "gyro", "columns": ["gx", "gy", "gz"], "unit": "rad/s", "noise_deg_per_s": 1.0}
UP = {
    "name": "up",
    "kind": "accelerometer",
    "columns": ["ax", "ay", "az"],
    "unit": "m/s^2",
    "bound_deg": 5.0,
}
FIELD = {
    "name": "field",
    "kind": "magnetometer",
    "columns": ["mx", "my", "mz"],
    "unit": "uT",
    "reference_ut": [0.0, 20.0, -40.0],
    "bound_deg": 5.0,
}
HEADER = "t,gx,gy,gz,ax,ay,az,mx,my,mz"


def configured(*directions, flow=GYRO, **others):
    tables = {
        "time_column": "t",
        "reference_frame": "ENU",
        "flow": flow,
        "directions": list(directions),
        "start": START,
    }
    return Configuration.model_validate(tables | others)


def csv(tmp_path, *rows, header=HEADER):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def read(tmp_path, *rows, configuration, header=HEADER):
    return logs.read_log(csv(tmp_path, *rows, header=header), configuration)


# --- units, axes, signs -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "number", "expected"),
    [("m/s^2", 9.80665, 9.80665), ("g", 1.0, 9.80665), ("mg", 1000.0, 9.80665)],
)
def test_units_of_acceleration(tmp_path, unit, number, expected):
    log = read(tmp_path, f"0,0,0,0,0,{number},0,1,0,0", configuration=configured(UP | {"unit": unit}))
    np.testing.assert_allclose(log.directions[0, 0], [0.0, expected, 0.0], rtol=1e-15)
    np.testing.assert_array_equal(log.references[0, 0], [0.0, 0.0, 9.80665])


@pytest.mark.parametrize(("unit", "number"), [("T", 5e-5), ("G", 0.5), ("mG", 500.0), ("uT", 50.0), ("nT", 50_000.0)])
def test_units_of_field(tmp_path, unit, number):
    log = read(tmp_path, f"0,0,0,0,1,0,0,0,{number},0", configuration=configured(FIELD | {"unit": unit}))
    np.testing.assert_allclose(log.directions[0, 0], [0.0, 5e-5, 0.0], rtol=1e-14)
    np.testing.assert_allclose(log.references[0, 0], [0.0, 2e-5, -4e-5], rtol=1e-14)


def test_units_of_rate_and_time(tmp_path):
    configuration = configured(flow=GYRO | {"unit": "deg/s"}, time_unit="ms")
    log = read(tmp_path, "1500,90,0,-180,1,0,0,1,0,0", "2500.5,0,0,0,1,0,0,1,0,0", configuration=configuration)
    np.testing.assert_allclose(log.rates[0], [np.pi / 2, 0.0, -np.pi], rtol=1e-15)
    np.testing.assert_array_equal(log.times, [1.5, 2.5005])


def test_axes_and_sign(tmp_path):
    # The sensor lies on its side: the body's x is its y, the body's y its -x.
    turned = {"axes": ["y", "-x", "z"]}
    sensors = [UP | turned | {"at_rest": "down"}, FIELD | turned]
    log = read(tmp_path, "0,1,2,3,1,2,3,4,5,6", configuration=configured(*sensors, flow=GYRO | turned))
    np.testing.assert_array_equal(log.rates[0], [2.0, -1.0, 3.0])
    np.testing.assert_array_equal(log.directions[0, 0], [-2.0, 1.0, -3.0])
    np.testing.assert_allclose(log.directions[0, 1], np.array([5.0, -4.0, 6.0]) * 1e-6, rtol=1e-15)


def test_axes_as_a_matrix(tmp_path):
    matrix = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
    sensor = UP | {"axes": np.round(matrix, 6).tolist()}
    log = read(tmp_path, "0,0,0,0,1,2,3,4,5,6", configuration=configured(sensor))
    np.testing.assert_allclose(log.directions[0, 0], matrix @ [1.0, 2.0, 3.0], atol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unit": "ft/s^2"}, "directions.0.*unit"),
        ({"axes": ["x", "y", "y"]}, "must be a rotation"),
        ({"axes": ["-x", "y", "z"]}, "must be a rotation"),
        ({"axes": [[1.0, 0.0, 0.0], [0.0, 1.1, 0.0], [0.0, 0.0, 1.0]]}, "must be a rotation"),
        ({"time_column": "t2"}, "time_column and time_unit belong together"),
        ({"bound_from": {"kind": "field", "disturbance_ut": 1.0}, "bound_deg": None}, "bound_from"),
        ({"bound_from": {"kind": "acceleration", "acceleration_m_per_s2": 1.0}}, "exactly one of bound_deg"),
        ({"reference": [0.0, 0.0, 1.0]}, "reference"),
        ({"kind": "gravimeter"}, "gravimeter"),
    ],
)
def test_configurations_that_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        configured(UP | change)


def test_nothing_is_guessed():
    for sensor in (UP, FIELD):
        with pytest.raises(ValueError, match="unit"):
            configured({key: value for key, value in sensor.items() if key != "unit"})
    with pytest.raises(ValueError, match="needs reference_frame"):
        configured(UP, reference_frame=None)
    sunny = {"name": "sun", "columns": ["ax", "ay", "az"], "bound_deg": 1.0}
    with pytest.raises(ValueError, match="needs reference_frame = 'J2000'"):
        configured(sunny | {"reference": {"kind": "sun", "time_zero": "2020-01-01T00:00:00Z"}})
    with pytest.raises(ValueError, match="timezone"):
        configured(sunny | {"reference": {"kind": "sun", "time_zero": "2020-01-01T00:00:00"}}, reference_frame="J2000")


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
@pytest.mark.parametrize("turns", ["body_to_reference", "reference_to_body"])
def test_order_and_direction_of_the_reference_attitude(tmp_path, order, turns):
    attitude = Rotation.from_rotvec([0.3, -0.2, 0.9])
    written = attitude if turns == "body_to_reference" else attitude.inv()
    numbers = written.as_quat(scalar_first=order == "wxyz") * 2.0
    truth = {"attitude_columns": ["q0", "q1", "q2", "q3"], "order": order, "turns": turns}
    row = "0,0,0,0," + ",".join(repr(float(number)) for number in numbers)
    log = read(tmp_path, row, configuration=configured(truth=truth), header="t,gx,gy,gz,q0,q1,q2,q3")
    np.testing.assert_allclose(log.true_attitudes[0], attitude.as_matrix(), atol=1e-15)


# --- references -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frame", "up"), [("ENU", [0, 0, 1]), ("NED", [0, 0, -1]), ("NWU", [0, 0, 1])])
def test_up(frame, up):
    np.testing.assert_array_equal(references.up(frame), up)
    # East is what it is in all of them.
    east = {"ENU": [1, 0, 0], "NED": [0, 1, 0], "NWU": [0, -1, 0]}[frame]
    np.testing.assert_array_equal(references.from_enu(np.array([1.0, 0.0, 0.0]), frame), east)


def test_world_model():
    """Berlin, from published tables: 49.8 µT, dip 68 degrees, declination 4.5 degrees east."""
    pytest.importorskip("ppigrf")
    place = {"latitude_deg": 52.5, "longitude_deg": 13.4, "height_m": 40.0, "date": "2021-06-01T00:00:00Z"}
    model = WorldModel.model_validate({"kind": "world_model"} | place)
    east, north, up = references.world_model_field(model, "ENU")
    assert np.hypot(np.hypot(east, north), up) == pytest.approx(49.8e-6, abs=0.4e-6)
    assert np.degrees(np.arctan2(-up, np.hypot(east, north))) == pytest.approx(68.0, abs=0.5)
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(4.5, abs=0.5)
    np.testing.assert_allclose(references.world_model_field(model, "NED"), [north, east, -up], rtol=1e-15)


@pytest.mark.parametrize("height_m", [-11_000.0, 0.0, 1e6])
@pytest.mark.parametrize("latitude_deg", [-90.0, -47.3, 0.0, 12.5, 45.0, 89.999, 90.0])
def test_the_world_model_is_exact(latitude_deg, height_m):
    """Beside a sum of solid harmonics in axes that are fixed to the Earth, which has neither angles nor a series."""
    pytest.importorskip("ppigrf")
    place = {"latitude_deg": latitude_deg, "longitude_deg": 200.0, "height_m": height_m, "date": "2013-03-02T11:00:00Z"}
    model = WorldModel.model_validate({"kind": "world_model"} | place)
    for frame in ("ENU", "NED", "NWU"):
        found = 1e6 * references.world_model_field(model, frame)
        np.testing.assert_allclose(found, field_of(model, frame), rtol=0.0, atol=1e-11)


def test_the_truth_of_the_field_is_a_field():
    """It is a slope, of a potential: without a source, and without a vortex. A dipole's is known."""
    dipole = {(n, m): 0.0 for n in range(1, 3) for m in range(-n, n + 1)} | {(1, 0): 3.0, (1, 1): -2.0, (1, -1): 1.0}
    moment, place = np.array([-2.0, 1.0, 3.0]), np.array([5000.0, 3000.0, -4500.0])
    away = np.linalg.norm(place)
    expected = (3.0 * place * (moment @ place) / away**2 - moment) * (6371.2 / away) ** 3
    np.testing.assert_allclose(-_slope(place, dipole), expected, rtol=0.0, atol=1e-14)
    drawn = np.random.default_rng(0).normal(size=300)
    some = {(n, m): drawn[17 * n + m] for n in range(1, 14) for m in range(-n, n + 1)}
    slopes = [(_slope(place + one, some) - _slope(place - one, some)) / 2.0 for one in np.eye(3)]
    size = np.abs(slopes).max()
    assert abs(np.trace(slopes)) < 1e-5 * size
    np.testing.assert_allclose(slopes, np.transpose(slopes), rtol=0.0, atol=1e-5 * size)


@pytest.mark.parametrize("date", ["1899-12-31T23:59:59Z", "2030-01-02T00:00:00Z", "2035-06-01T00:00:00Z"])
def test_world_model_beyond_its_coefficients(date, capfd):
    """The package goes on with its last ones, and prints that where JSON may go."""
    pytest.importorskip("ppigrf")
    place = {"kind": "world_model", "latitude_deg": 48.0, "longitude_deg": 11.0}
    with pytest.raises(FileError, match=rf"no field for {date[:10]}: its coefficients are of 1900-01-01 to 20\d\d-01"):
        references.world_model_field(WorldModel.model_validate(place | {"date": date}), "ENU")
    references.world_model_field(WorldModel.model_validate(place | {"date": "2030-01-01T00:00:00Z"}), "ENU")
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("pole", [90.0, -90.0])
def test_world_model_at_a_pole(pole):
    """As a kilometre away from it on the same meridian."""
    pytest.importorskip("ppigrf")
    at_pole, beside = (
        references.world_model_field(
            WorldModel.model_validate(
                {"kind": "world_model", "latitude_deg": latitude, "longitude_deg": 30.0, "date": "2025-01-01T00:00:00Z"}
            ),
            "ENU",
        )
        for latitude in (pole, pole * (1.0 - 1e-4))
    )
    np.testing.assert_allclose(at_pole, beside, rtol=0.0, atol=2e-8)


@pytest.mark.parametrize("height", [-2e4, 3.6e7])
def test_world_model_where_it_is_not_stated(height):
    place = {"kind": "world_model", "latitude_deg": 48.0, "longitude_deg": 11.0, "date": "2025-01-01T00:00:00Z"}
    with pytest.raises(ValueError, match="height_m"):
        WorldModel.model_validate(place | {"height_m": height})


def test_rest_phase(tmp_path):
    """The body rests in a known attitude in a known field; afterwards it does not."""
    attitude = Rotation.from_rotvec([0.4, -0.7, 1.1])
    declination = np.deg2rad(5.0)
    field = np.array([15.0 * np.sin(declination), 15.0 * np.cos(declination), -40.0])
    force, seen = attitude.inv().apply([0.0, 0.0, 9.81]), attitude.inv().apply(field)
    cells = ",".join(repr(float(number)) for number in (*force, *seen))
    rows = [*(f"{0.1 * i},0,0,0,{cells}" for i in range(10)), *(f"{0.1 * i},0,0,0,5,1,2,3,2,1" for i in range(10, 20))]
    sensor = {key: value for key, value in FIELD.items() if key != "reference_ut"}
    by_gravity = {"kind": "rest_phase", "from_s": 0.0, "to_s": 0.91, "declination_deg": 5.0}
    log = read(tmp_path, *rows, configuration=configured(UP, sensor | {"reference": by_gravity}))
    np.testing.assert_allclose(log.references[0, 1], field * 1e-6, rtol=1e-12, atol=1e-17)
    quaternion = attitude.as_quat(scalar_first=True).tolist()
    by_attitude = {"kind": "rest_phase", "from_s": 0.0, "to_s": 0.91, "attitude_qw_qx_qy_qz": quaternion}
    log = read(tmp_path, *rows, configuration=configured(sensor | {"reference": by_attitude}))
    np.testing.assert_allclose(log.references[0, 0], field * 1e-6, rtol=1e-12, atol=1e-17)
    later = configured(sensor | {"reference": by_attitude | {"from_s": 5.0, "to_s": 6.0}})
    with pytest.raises(FileError, match="'field' shows nothing in the rest phase from 5 s to 6 s"):
        read(tmp_path, *rows, configuration=later)


def test_a_rest_phase_that_is_none(tmp_path):
    angles = np.linspace(0.0, 1.5, 50)
    rows = [f"{0.1 * i},0,0,0,0,0,9.8,{40 * np.cos(a)},{40 * np.sin(a)},0" for i, a in enumerate(angles)]
    sensor = {key: value for key, value in FIELD.items() if key != "reference_ut"}
    rest = {"kind": "rest_phase", "from_s": 0.0, "to_s": 5.0, "declination_deg": 0.0}
    with pytest.raises(FileError, match="'field' turns in the rest phase from 0 s to 5 s"):
        read(tmp_path, *rows, configuration=configured(UP, sensor | {"reference": rest}))


def test_rest_phase_in_ned():
    phase = RestPhase(kind="rest_phase", from_s=0.0, to_s=1.0, declination_deg=0.0)
    field = references.rest_field(phase, np.array([3.0, 0.0, -4.0]), np.array([0.0, 0.0, 9.8]), "NED")
    np.testing.assert_allclose(field, [3.0, 0.0, 4.0], atol=1e-15)


def test_sun_by_time():
    """Against Fermi's clock, which counts from the beginning of 2001."""
    recorded = fermi.telemetry()
    reference = SunByTime.model_validate({"kind": "sun", "time_zero": "2001-01-01T00:00:00Z"})
    expected = sun.sun_direction_j2000(sun.fermi_julian_date(recorded.met))
    angles = np.linalg.norm(references.sun_directions(reference, recorded.met) - expected, axis=1)
    assert np.rad2deg(angles).max() < 0.001


@pytest.mark.parametrize(("origin", "first"), [("file", 466430147.5), ("first", 0.5)])
def test_sun_in_a_log(tmp_path, origin, first):
    reference = {"kind": "sun", "time_zero": "2001-01-01T00:00:00Z"}
    sensor = {"name": "sun", "columns": ["ax", "ay", "az"], "bound_deg": 1.0, "reference": reference}
    configuration = configured(sensor, reference_frame="J2000", timing={"origin": origin})
    log = read(tmp_path, "466430147.5,0,0,0,1,0,0,,,", "480000000,0,0,0,,,,,,", configuration=configuration)
    assert log.times[0] == first
    expected = sun.sun_direction_j2000(sun.fermi_julian_date([466430147.5, 480000000.0]))
    np.testing.assert_allclose(log.references[:, 0], expected, atol=1e-5)
    assert np.linalg.norm(expected[1] - expected[0]) > 1.0


# --- times ------------------------------------------------------------------------------------------------------------


def test_sensors_of_different_rates(tmp_path):
    """Gyro at every row, the others now and then; a row for each message, several at one time."""
    rows = ["0,1,0,0,,,,,,", "0,,,,0,0,9.8,,,", "0.1,2,0,0,,,,,,", "0.2,3,0,0,,,,1,2,3", "0.2,,,,0,9.8,0,,,"]
    configuration = configured(UP, FIELD, timing={"repeated": "merge", "largest_gap_s": 1.0})
    log = read(tmp_path, *rows, configuration=configuration)
    np.testing.assert_array_equal(log.times, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(log.rates[:, 0], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(np.isfinite(log.directions[:, :, 0]), [[True, False], [False, False], [True, True]])
    np.testing.assert_array_equal(log.directions[2, 0], [0.0, 9.8, 0.0])
    assert log.place(2) == "line 5 (0.200000 s)"


@pytest.mark.parametrize(
    ("interval_rate", "expected"), [("mean_of_ends", [1.0, 1.5, 3.0]), ("first_sample", [1, 1, 3])]
)
def test_gyro_between_its_samples(tmp_path, interval_rate, expected):
    header = "tg,gx,gy,gz,ta,ax,ay,az"
    rows = ["100,1,0,0,90,1,0,0", "200,3,0,0,125,1,0,0", ",,,,300,0,1,0"]
    clock = {"time_column": "tg", "time_unit": "ms", "interval_rate": interval_rate}
    up = UP | {"time_column": "ta", "time_unit": "ms"}
    configuration = configured(up, flow=GYRO | clock, timing={"largest_gap_s": 0.2})
    log = read(tmp_path, *rows, configuration=configuration, header=header)
    # What lies before the gyro's first sample or after its last one cannot be used.
    np.testing.assert_allclose(log.times, [0.1, 0.125, 0.2])
    np.testing.assert_allclose(log.rates[:, 0], expected)
    np.testing.assert_array_equal(np.isfinite(log.directions[:, 0, 0]), [False, True, False])


def test_a_known_delay_is_subtracted(tmp_path):
    rows = [f"{0.1 * i:.1f},{i},0,0,{i + 1},0,0,1,0,0" for i in range(5)]
    configuration = configured(UP | {"delay_s": 0.1}, flow=GYRO | {"delay_s": -0.05})
    log = read(tmp_path, *rows, configuration=configuration)
    np.testing.assert_allclose(log.times, [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.45], atol=1e-15)
    # At 0.1 s the accelerometer has what is stamped 0.2 s, and the gyro is halfway from its first sample to its second.
    np.testing.assert_array_equal(log.directions[1, 0], [3.0, 0.0, 0.0])
    np.testing.assert_allclose(log.rates[:, 0], [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0], atol=1e-12)


def test_delays_that_make_stamps_meet(tmp_path):
    step = 1.0 / 285.714
    rows = [f"{step * i!r},{i},0,0,1,0,{i + 1},1,0,0" for i in range(1000)]
    log = read(tmp_path, *rows, configuration=configured(UP | {"delay_s": 3 * step}))
    assert len(log.times) == 1000
    np.testing.assert_array_equal(log.directions[:997, 0, 2], np.arange(4.0, 1001.0))
    separate = configured(UP | {"delay_s": 3 * step}, timing={"same_within_s": 0.0})
    assert len(read(tmp_path, *rows, configuration=separate).times) > 1000
    too_long = configured(UP | {"delay_s": 3 * step}, timing={"same_within_s": 0.004})
    with pytest.raises(FileError, match=r"same_within_s = 0\.004 makes one row of several samples"):
        read(tmp_path, *rows, configuration=too_long)


def test_stamps_so_near_that_they_hold_two_samples_of_the_gyro(tmp_path):
    """Between the two the rate would be taken for a straight line, with an error that nobody stated."""
    header = "t1,gx,gy,gz,t2,ax,ay,az"
    rows = [f"{0.002 * i:.3f},0,0,{i},{0.01 * i + 0.001:.3f},0,0,1" for i in range(400)]
    own = [{"time_column": f"t{i}", "time_unit": "s"} for i in (1, 2)]
    near, too_wide = (
        configured(UP | own[1], flow=GYRO | own[0], timing={"same_within_s": within}) for within in (0.0015, 0.003)
    )
    log = read(tmp_path, *rows, configuration=near, header=header)
    assert len(log.times) == 400
    with pytest.raises(FileError, match=r"same_within_s = 0\.003 makes one row of several samples of the gyro"):
        read(tmp_path, *rows, configuration=too_wide, header=header)


def test_control_torque_acts_until_its_time(tmp_path):
    flow = {
        "kind": "rigid_body",
        "inertia_kg_m2": [1.0, 1.0, 1.0],
        "step_s": 0.1,
        "control_torque_columns": ["gx", "gy", "gz"],
    }
    rows = ["0,1,0,0,1,0,0,,,", "1,2,0,0,,,,,,", "2,3,0,0,1,0,0,,,"]
    log = read(tmp_path, *rows, configuration=configured(UP | {"delay_s": 0.5}, flow=flow))
    np.testing.assert_array_equal(log.times, [-0.5, 0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_array_equal(log.control_torques[:, 0], [1.0, 1.0, 2.0, 2.0, 3.0, 3.0])


def test_nanoseconds_since_1970(tmp_path):
    stamps = [1_700_000_000_123_456_789 + 5_000_000 * i for i in range(3)]
    rows = [f"{stamp},{i},0,0,1,0,0,1,0,0" for i, stamp in enumerate(stamps)]
    with pytest.raises(FileError, match=r"column 't': 1700000000123456789 ns lose digits as seconds; timing.origin"):
        read(tmp_path, *rows, configuration=configured(UP, time_unit="ns", timing={"origin": "file"}))
    log = read(tmp_path, *rows, configuration=configured(UP, time_unit="ns"))
    assert log.origin == 1_700_000_000
    np.testing.assert_allclose(log.times, 0.123456789 + 0.005 * np.arange(3), rtol=1e-15)


TURNING = {"kind": "linear", "moment_n_m": [0.1, 0.0, 0.0], "direction": [1.0, 0.0, 0.0]}
TURNING |= {"turn_rad_per_s": [0.0, 0.0, 0.1]}
ORBIT = {"kind": "gravity_gradient", "orbit_rate_rad_per_s": 0.01}


@pytest.mark.parametrize("potential", [ORBIT, TURNING, {"kind": "sum", "potentials": [{"kind": "free"}, ORBIT]}])
def test_a_potential_that_turns_says_which_time_it_is_stated_for(tmp_path, potential):
    """Of another second of the file it would be another; nobody means 1970."""
    flow = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 1.0, 1.0], "step_s": 0.1, "potential": potential}
    first = {"timing": {"origin": "first"}}
    rows = ["37.5,0,0,0,1,0,0,1,0,0", "38,0,0,0,1,0,0,1,0,0"]
    assert read(tmp_path, *rows, configuration=configured(UP, flow=flow)).origin == 0
    with pytest.raises(FileError, match=r"flow.potential: .* count from 37 s of the file .* stated_at_s"):
        read(tmp_path, *rows, configuration=configured(UP, flow=flow, **first))
    one = potential.get("potentials", [potential])[-1]
    stated = {"potentials": [one | {"stated_at_s": 0.0}]} if "potentials" in potential else {"stated_at_s": 0.0}
    for kept in (potential | stated, TURNING | {"turn_rad_per_s": [0.0, 0.0, 0.0]}):
        log = read(tmp_path, *rows, configuration=configured(UP, flow=flow | {"potential": kept}, **first))
        assert log.origin == 37


GOOD = "0,0,0,0,1,0,0,1,0,0"


@pytest.mark.parametrize(
    ("rows", "timing", "message"),
    [
        ((GOOD, "1,0,0,0,1,0,0,1,0,0", "1,0,0,0,1,0,0,1,0,0"), {}, r"line 4, column 1 \(t\): not after .*'merge'"),
        ((GOOD, "1,0,0,0,1,0,0,1,0,0", "0.5,0,0,0,1,0,0,1,0,0"), {}, r"line 4, column 1 \(t\): the clock was set back"),
        ((GOOD, "nan,0,0,0,1,0,0,1,0,0"), {"not_a_number": "missing"}, r"line 3, column 1 \(t\): not a finite number"),
        ((GOOD, ",0,0,0,1,0,0,1,0,0"), {}, r"line 3, column 1 \(t\): empty"),
        ((GOOD, "1,0,0,0,1,nan,0,1,0,0"), {}, r"line 3, column 6 \(ay\): not a finite number; .* 'missing'"),
        ((GOOD, "1,0,0,0,1,inf,0,1,0,0"), {"not_a_number": "missing"}, r"line 3, column 6 \(ay\): infinite"),
        ((GOOD, "1,0,0,0,1,,0,1,0,0"), {}, r"line 3, column 5 \(ax\): a number, but ax ay az are empty only together"),
        ((GOOD, "1,,,,1,0,0,1,0,0"), {}, r"line 3, column 2 \(gx\): empty; timing.largest_gap_s"),
        (
            (GOOD, "3,0,0,0,1,0,0,1,0,0"),
            {"largest_gap_s": 2.0},
            r"line 3, column 2 \(gx\): 3 s after the sample of the",
        ),
        ((GOOD, "1,0,0,0,0,0,0,1,0,0"), {}, r"line 3, column 5 \(ax\): 'up' has no direction: ax ay az are all zero"),
        ((GOOD, "1,0,0,0,0,0,1e-200,1,0,0"), {}, r"'up' has no direction: ax ay az are all below 1e-130 in size"),
        ((GOOD, "1,0,0,zero,1,0,0,1,0,0"), {}, r"line 3, column 4 \(gz\): not a number: 'zero'"),
        ((GOOD, "1,0,0,0,1,0,0,1,0"), {}, "line 3: 9 columns, but the header has 10"),
        ((), {}, "a header, but no rows below it"),
    ],
)
def test_rows_that_are_refused(tmp_path, rows, timing, message):
    with pytest.raises(FileError, match=message) as caught:
        read(tmp_path, *rows, configuration=configured(UP, FIELD, timing=timing))
    assert str(caught.value).startswith(f"{tmp_path / 'log.csv'}: ")


def test_rows_that_are_left_out(tmp_path):
    rows = [
        "0,0,0,0,1,0,0,1,0,0",
        "1,1,0,0,1,0,0,1,0,0",
        "2,2,0,0,1,0,0,1,0,0",
        "4,4,0,0,2,0,0,1,0,0",
        "4,9,0,0,4,0,0,1,0,0",
        "3,3,0,0,3,0,0,1,0,0",
        "5,5,0,0,,nan,,1,0,0",
        "6,6,0,0,1,0,0,1,0,0",
    ]
    timing = {"backward": "drop", "repeated": "merge", "not_a_number": "missing"}
    log = read(tmp_path, *rows, configuration=configured(UP, timing=timing))
    np.testing.assert_array_equal(log.times, [0.0, 1.0, 2.0, 4.0, 5.0, 6.0])
    np.testing.assert_array_equal(log.rates[:, 0], log.times)
    np.testing.assert_array_equal(log.directions[:, 0, 0], [1.0, 1.0, 1.0, 2.0, np.nan, 1.0])
    np.testing.assert_array_equal(log.rows, [0, 1, 2, 3, 6, 7])


@pytest.mark.parametrize(
    ("times", "message"),
    [
        # Set back by 4 s: of the 9 s that went by, the rows that are left would show 5.
        ([0, 1, 2, 3, 4, 5, 2, 3, 4, 5, 6, 7], "line 8, column 1 .*: the clock was set back here"),
        ([0, 1, 2, 3, 4, 5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5], "line 8, column 1 .*: the clock was set back here"),
        # One stamp far ahead: the row after it would seem to be a second later.
        ([0, 1, 2, 9, 4, 5, 6, 7, 8, 9, 10, 11], "line 5, column 1 .*: after the time of rows below"),
    ],
)
def test_late_rows_are_left_out_only_where_the_others_are_right(tmp_path, times, message):
    rows = [f"{time},{i},0,0,1,0,0,1,0,0" for i, time in enumerate(times)]
    configuration = configured(UP, timing={"backward": "drop", "repeated": "merge"})
    path = csv(tmp_path, *rows)
    for reader in (logs.read_log, logs.read_samples):
        with pytest.raises(FileError, match=message):
            reader(path, configuration)


def test_columns_of_different_lengths(tmp_path):
    np.savez(tmp_path / "log.npz", t=np.arange(3.0), gyr=np.zeros((3, 3)), acc=np.ones((4, 3)), ta=np.arange(4.0))
    gyr = GYRO | {"columns": [f"gyr[{i}]" for i in range(3)]}
    acc = UP | {"columns": [f"acc[{i}]" for i in range(3)]}
    with pytest.raises(FileError, match=r"'acc\[0\]' and 't' have not the same rows"):
        logs.read_log(tmp_path / "log.npz", configured(acc, flow=gyr))
    own = acc | {"time_column": "ta", "time_unit": "ms"}
    log = logs.read_log(tmp_path / "log.npz", configured(own, flow=gyr))
    np.testing.assert_allclose(log.times, [0.0, 0.001, 0.002, 0.003, 1.0, 2.0])


@given(st.lists(st.integers(0, 400), min_size=1, max_size=60, unique=True), st.integers(0, 30))
def test_no_stamp_moves_by_more_than_what_makes_rows_one(milliseconds, within):
    """Bounds have that much added. A stamp near one that was near the first begins a row of its own."""
    stamps = np.sort(milliseconds).astype(np.float64)
    begins = _begin_rows(stamps, float(within))
    expected, first = [], -np.inf
    for stamp in stamps:
        expected.append(stamp - first > within)
        first = stamp if expected[-1] else first
    np.testing.assert_array_equal(begins, expected)
    rows = stamps[begins][np.cumsum(begins) - 1]
    assert (stamps - rows <= within).all()
    assert (np.diff(stamps[begins]) > within).all()
    assert len(_begin_rows(np.empty(0), float(within))) == 0


def test_sensors_whose_stamps_make_a_chain(tmp_path):
    """Each stamp is 4 ms after that of another sensor; with 5 ms, two of them make a row, and never three.

    Where one of two is the gyro's, the row has its stamp: a line between two of its samples has no corner within a row.
    """
    header = "t1,gx,gy,gz,t2,ax,ay,az,t3,mx,my,mz"
    rows = [
        f"{0.012 * i:.3f},0,0,1,{0.012 * i + 0.004:.3f},0,0,{i + 1},{0.012 * i + 0.008:.3f},{i + 1},0,0"
        for i in range(50)
    ]
    own = [{"time_column": f"t{i}", "time_unit": "s"} for i in (1, 2, 3)]
    configuration = configured(
        UP | own[1], FIELD | own[2] | {"unit": "T"}, flow=GYRO | own[0], timing={"same_within_s": 0.005}
    )
    log = read(tmp_path, *rows, configuration=configuration, header=header)
    for i, late in ((0, 0.004), (1, 0.008)):
        there = np.isfinite(log.directions[:, i, 0])
        stamps = 0.012 * np.arange(50) + late
        moved = stamps[: there.sum()] - log.times[there]
        assert (np.abs(moved) <= 0.005 + 1e-9).all()
    assert np.isin(log.gyro_times, log.times).all()


def test_what_was_measured_beside_its_row_is_known(tmp_path):
    header = "t1,gx,gy,gz,t2,ax,ay,az"
    late = [0.001 * (i % 3) for i in range(60)]
    rows = [f"{0.01 * i:.3f},0,0,1,{0.01 * i + late[i]:.3f},0,0,1" for i in range(60)]
    own = [{"time_column": f"t{i}", "time_unit": "s"} for i in (1, 2)]
    near = configured(UP | own[1], flow=GYRO | own[0], timing={"same_within_s": 0.004})
    log = read(tmp_path, *rows, configuration=near, header=header)
    sampled = log.sampled(0)
    assert sampled is not None
    np.testing.assert_allclose(sampled[:-1], 0.01 * np.arange(59) + late[:59], atol=1e-12)  # the last has no rate
    np.testing.assert_array_equal(log.since(7).sampled(0), sampled[7:])
    apart = configured(UP | own[1], flow=GYRO | own[0])
    assert read(tmp_path, *rows, configuration=apart, header=header).sampled(0) is None
    together = configured(UP, timing={"same_within_s": 0.004})
    rows = [f"{0.01 * i:.3f},0,0,1,0,0,1,1,0,0" for i in range(60)]
    assert read(tmp_path, *rows, configuration=together).sampled(0) is None


@pytest.mark.parametrize("within", [0.0, 0.002, 0.005])
@pytest.mark.parametrize("batch", [1, 2, 3, 7, 64])
def test_what_makes_a_row_does_not_depend_on_where_a_batch_ends(monkeypatch, tmp_path, batch, within):
    """Stamps of two sensors each in its own column: a row's second stamp may be in the next batch."""
    rng = np.random.default_rng(3)
    gyro = 0.01 * np.arange(200.0) + rng.uniform(0.0, 0.003, 200)
    up = 0.01 * np.arange(200.0) + rng.uniform(0.0, 0.004, 200)
    columns = {f"g{axis}": rng.standard_normal(200) for axis in "xyz"} | {f"a{axis}": np.ones(200) for axis in "xyz"}
    pq.write_table(pa.table(columns | {"t1": gyro, "t2": up}), tmp_path / "log.parquet")
    own = [{"time_column": f"t{i}", "time_unit": "s"} for i in (1, 2)]
    configuration = configured(UP | own[1], flow=GYRO | own[0], timing={"same_within_s": within})
    whole = logs.read_log(tmp_path / "log.parquet", configuration)
    monkeypatch.setattr("elliptude.io.readers.parquet.BATCH_ROWS", batch)
    in_pieces = logs.read_log(tmp_path / "log.parquet", configuration)
    np.testing.assert_array_equal(in_pieces.times, whole.times)
    np.testing.assert_array_equal(in_pieces.directions, whole.directions)
    np.testing.assert_array_equal(in_pieces.rates, whole.rates)


# --- against a slow alignment, and piece by piece ---------------------------------------------------------------------


def slow_alignment(rows, delays):
    """Rows of (time, gyro or None, up or None, field or None): dictionaries by exact time, nothing vectorised."""
    samples = [{}, {}, {}]
    stamps = set()
    for time, *cells in rows:
        for one, cell, delay in zip(samples, cells, delays, strict=True):
            stamps.add(time - delay)
            if cell is not None and time - delay not in one:
                one[time - delay] = cell
    gyro = sorted(samples[0].items())
    found = []
    for time in sorted(stamps):
        if not gyro or not gyro[0][0] <= time <= gyro[-1][0]:
            continue
        rate = None
        for (before, first), (after, second) in itertools.pairwise(gyro):
            if before <= time <= after:
                share = (time - before) / (after - before)
                rate = first + share * (second - first)
                break
        if len(gyro) == 1:
            rate = gyro[0][1]
        found.append((time, rate, samples[1].get(time), samples[2].get(time)))
    return found


@st.composite
def recordings(draw):
    steps = draw(st.lists(st.sampled_from([0, 1, 1, 1, 2, 5]), min_size=1, max_size=40))
    times = np.cumsum(steps) / 8.0  # exact in binary, so that stamps can meet
    cells = st.one_of(st.none(), st.integers(1, 9).map(float))
    rows = [(float(time), draw(cells), draw(cells), draw(cells)) for time in times]
    delays = draw(st.tuples(*[st.sampled_from([0.0, 0.125, -0.25, 0.5])] * 3))
    return rows, delays


@settings(max_examples=200, deadline=None)
@given(recordings(), st.sampled_from([60, 200, 1 << 20]))
def test_against_a_slow_alignment(tmp_path_factory, recording, batch_bytes):
    rows, delays = recording
    folder = tmp_path_factory.mktemp("log")

    def triple(cell):
        return ",," if cell is None else f"{cell},0,0"

    path = csv(folder, *(f"{time!r},{triple(g)},{triple(u)},{triple(f)}" for time, g, u, f in rows))
    configuration = configured(
        UP | {"delay_s": delays[1]},
        FIELD | {"delay_s": delays[2], "unit": "T"},
        flow=GYRO | {"delay_s": delays[0]},
        timing={"repeated": "merge", "largest_gap_s": 1e3},
    )
    expected = slow_alignment(rows, delays)
    before = csv_files.BATCH_BYTES
    csv_files.BATCH_BYTES = batch_bytes
    try:
        if not expected:
            with pytest.raises(FileError, match="no row between the first and the last sample of the gyro"):
                logs.read_log(path, configuration)
            return
        log = logs.read_log(path, configuration)
    finally:
        csv_files.BATCH_BYTES = before
    np.testing.assert_array_equal(log.times, [row[0] for row in expected])
    np.testing.assert_allclose(log.rates[:, 0], [row[1] for row in expected], rtol=1e-12)
    for i in (0, 1):
        values = [np.nan if row[2 + i] is None else row[2 + i] for row in expected]
        np.testing.assert_array_equal(log.directions[:, i, 0], values)


def test_pieces_are_small_and_make_the_whole(tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    rows = [f"{0.01 * i:.2f},{','.join(map(repr, rng.standard_normal(9).tolist()))}" for i in range(3000)]
    path = csv(tmp_path, *rows)
    configuration = configured(UP | {"delay_s": 0.013}, FIELD | {"delay_s": 0.5}, flow=GYRO | {"delay_s": -0.004})
    whole = logs.read_log(path, configuration)
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 5000)
    pieces = list(logs.read_pieces(path, configuration))
    assert len(pieces) > 50
    assert max(len(piece.times) for piece in pieces) < 300
    again = logs.read_log(path, configuration)
    for name in ("times", "directions", "references", "rates", "rows"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)


# --- formats whose streams have stamps of their own -------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["ulog", "mcap"])
def test_streams_with_stamps_of_their_own(tmp_path, kind):
    pytest.importorskip({"ulog": "pyulog", "mcap": "rosbags"}[kind])
    count = 9
    stamps = 2_000_000_000 + 5_000_000 * np.arange(count)  # ns
    rates, forces, fields = np.random.default_rng(0).standard_normal((3, count, 3)).astype(np.float32).astype(float)
    if kind == "ulog":
        path = tmp_path / "log.ulg"
        imu = {"timestamp": stamps // 1000, "gyro_rad": rates, "accelerometer_m_s2": forces}
        mag = {"timestamp": stamps[::2] // 1000, "field": fields[::2]}
        recorders.write_ulog(path, [("sensor_combined", 0, imu), ("sensor_mag", 0, mag)])
        names = ["sensor_combined.gyro_rad[{}]", "sensor_combined.accelerometer_m_s2[{}]", "sensor_mag.field[{}]"]
        columns = [[name.format(i) for i in range(3)] for name in names]
    else:
        path = tmp_path / "log"
        recorders.write_bag(path, kind, stamps.tolist(), rates, forces, fields)
        names = ["/imu/data.angular_velocity", "/imu/data.linear_acceleration", "/imu/mag.magnetic_field"]
        columns = [[f"{name}.{axis}" for axis in "xyz"] for name in names]
    tables = {
        "reference_frame": "NED",
        "flow": GYRO | {"columns": columns[0]},
        "directions": [UP | {"columns": columns[1]}, FIELD | {"columns": columns[2], "delay_s": 0.001, "unit": "T"}],
        "start": START,
    }
    log = logs.read_log(path, Configuration.model_validate(tables))
    own = 2.0 + 0.005 * np.arange(count)
    late = own[::2][1:] - 0.001  # the first one lies before the gyro's first sample
    np.testing.assert_allclose(log.times, np.sort(np.concatenate([own, late])), rtol=1e-14)
    there = np.isfinite(log.directions[:, 1, 0])
    np.testing.assert_array_equal(log.directions[there, 1], fields[::2][1:])
    np.testing.assert_array_equal(log.directions[~there, 0], forces)
    np.testing.assert_allclose(log.rates[there], 0.2 * rates[1::2] + 0.8 * rates[2::2], rtol=1e-9)
    with pytest.raises(FileError, match="has stamps of its own"):
        logs.read_log(path, Configuration.model_validate(tables | {"time_column": "t"}))
    samples = {one.name: one for one in logs.read_samples(path, Configuration.model_validate(tables))}
    assert [len(samples[name].times) for name in ("the gyro", "up", "field")] == [9, 9, 5]
