"""Configurations: what is accepted, and that messages name the file and the key."""

import numpy as np
import pytest
import tomlkit
from elliptude import GravityGradient, UniformGravity
from elliptude.configuration import Configuration, read_configuration
from elliptude.configuration.rules import Rule, hand_held
from elliptude.estimation.direction_rows import direction_rows
from elliptude.io.files import FileError
from elliptude.logs.log import Log
from elliptude.simulation import fermi
from elliptude.simulation.scenarios import Scenario


def pendulum():
    return {
        "flow": {
            "kind": "rigid_body",
            "inertia_kg_m2": [0.13, 0.28, 0.17],
            "step_s": 0.005,
            "order": 4,
            "potential": {
                "kind": "uniform_gravity",
                "mass_kg": 1.0,
                "gravity_m_per_s2": 9.81,
                "center_of_mass_m": [0.0, 0.0, 0.3],
            },
        },
        "directions": [
            {"name": "sun", "columns": ["sx", "sy", "sz"], "reference": [1.0, 0.0, 0.0], "bound_deg": 7.0},
            {"name": "mag", "columns": ["mx", "my", "mz"], "reference_columns": ["ex", "ey", "ez"], "bound_deg": 2.0},
        ],
        "rate": {"columns": ["wx", "wy", "wz"], "bound_deg_per_s": 7.0},
        "start": {"kind": "first_measurement"},
    }


def gyro():
    tables = pendulum() | {
        "flow": {"kind": "gyro", "columns": ["wx", "wy", "wz"], "noise_deg_per_s": 0.1},
        "start": {
            "kind": "given",
            "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0],
            "P_diagonal": [0.1, 0.1, 0.1, 0.01, 0.01, 0.01],
        },
    }
    del tables["rate"]
    return tables


def changed(tables, path, value):
    """A copy with the value at a dotted path; None removes it."""
    tables = tomlkit.parse(tomlkit.dumps(tables)).unwrap()
    here = tables
    *folders, key = [int(part) if part.isdigit() else part for part in path.split(".")]
    for part in folders:
        here = here[part]
    if value is None:
        del here[key]
    else:
        here[key] = value
    return tables


def read(tmp_path, tables):
    file = tmp_path / "estimate.toml"
    file.write_text(tomlkit.dumps(tables), encoding="utf-8")
    return read_configuration(file)


def test_rigid_body(tmp_path):
    configuration = read(tmp_path, pendulum())
    flow = configuration.flow.build()
    np.testing.assert_array_equal(flow.body.inertia, np.diag([0.13, 0.28, 0.17]))
    assert isinstance(flow.potential, UniformGravity)
    assert (flow.step, flow.order) == (0.005, 4)
    np.testing.assert_array_equal(flow.potential.center_of_mass, [0.0, 0.0, 0.3])
    np.testing.assert_allclose(configuration.directions[0].bound(), np.deg2rad(7.0) ** 2 * np.eye(3), rtol=1e-15)
    np.testing.assert_allclose(configuration.rate.bound(), np.deg2rad(7.0) ** 2 * np.eye(3), rtol=1e-15)
    assert configuration.time_column == "time_s"
    assert configuration.estimator.mode == "first_order"


def test_other_choices(tmp_path):
    tables = pendulum()
    tables["flow"]["inertia_kg_m2"] = [[1.0, 0.1, 0.0], [0.1, 2.8, 0.0], [0.0, 0.0, 2.0]]
    tables["flow"]["potential"] = {"kind": "gravity_gradient", "orbit_rate_rad_per_s": 1e-3}
    tables["flow"]["unknown_torque_n_m"] = 2.0
    shape = [[0.2, 0.1, 0.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.3]]
    del tables["directions"][0]["bound_deg"], tables["rate"]["bound_deg_per_s"]
    tables["directions"][0]["bound_rad2"] = shape
    tables["rate"]["bound_rad2_per_s2"] = shape
    weight = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    tables["estimator"] = {"mode": "paper", "criterion": "weighted_trace", "weight_diagonal": weight}
    configuration = read(tmp_path, tables)
    flow = configuration.flow.build()
    assert isinstance(flow.potential, GravityGradient)
    assert flow.potential.orbit_rate == 1e-3
    np.testing.assert_allclose(flow.unknown_torque, 4.0 * np.eye(3))
    assert flow.body.inertia[0, 1] == 0.1
    np.testing.assert_array_equal(configuration.directions[0].bound(), shape)
    np.testing.assert_array_equal(configuration.rate.bound(), shape)
    np.testing.assert_array_equal(configuration.estimator.weight(), np.diag(weight))


def test_gyro_and_given_start(tmp_path):
    tables = gyro()
    tables["start"]["attitude_qw_qx_qy_qz"] = [3.0, 0.0, 0.0, 3.0]
    configuration = read(tmp_path, tables)
    np.testing.assert_allclose(configuration.flow.build().noise, np.deg2rad(0.1) ** 2 * np.eye(3), rtol=1e-15)
    start = configuration.start.build()
    np.testing.assert_allclose(start.attitude, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(np.diag(start.shape), tables["start"]["P_diagonal"])


def test_the_one_that_ships():
    configuration = fermi.configuration()
    assert [sensor.bound_deg for sensor in configuration.directions] == [2.0, fermi.STAR_BOUND_DEG]
    assert configuration.flow.noise_deg_per_s == 0.005


@pytest.mark.parametrize(
    ("tables", "path", "value", "message"),
    [
        (pendulum(), "flow.step_s", None, "flow.step_s: "),
        (pendulum(), "flow.step_s", -1.0, "flow.step_s: "),
        (pendulum(), "flow.step_s", "0.1", "flow.step_s: "),
        (pendulum(), "flow.order", 3, "flow.order: "),
        (pendulum(), "flow.steps", 3, "flow.steps: "),
        (pendulum(), "flow.kind", "rigid", "flow: "),
        (pendulum(), "flow.inertia_kg_m2", [1.0, 1.0, 3.0], "flow: "),
        (pendulum(), "flow.potential.mass_kg", 0.0, "flow.potential.mass_kg: "),
        (pendulum(), "flow.potential.kind", "springs", "flow.potential: "),
        (pendulum(), "directions.0.bound_deg", None, "directions[0]: give exactly one of bound_deg"),
        (pendulum(), "directions.0.bound_deg", 0.0, "directions[0].bound_deg: "),
        (pendulum(), "directions.0.bound_deg", float("nan"), "directions[0].bound_deg: "),
        (pendulum(), "directions.0.reference", [0.0, 0.0, 0.0], "directions[0].reference: "),
        (pendulum(), "directions.1.reference", [1.0, 0.0, 0.0], "directions[1]: give exactly one of ref"),
        (pendulum(), "directions.1.columns", ["a", "b", "b"], "directions[1].columns: "),
        (pendulum(), "directions.1.name", "sun", "different names"),
        (pendulum(), "directions.1.name", "rate", "directions: the name 'rate' is that of the measured angular vel"),
        (pendulum(), "directions.1.name", "gyro", "directions: the name 'gyro' is that of the gyro"),
        (pendulum(), "directions.1.name", "true_attitude", "directions: the name 'true_attitude' is that of the tr"),
        (pendulum(), "directions.1", None, "two directions or more"),
        (pendulum(), "rate", None, "needs a rate"),
        (pendulum(), "start.bias_bound_deg_per_s", 1.0, "bias_bound_deg_per_s belongs to"),
        (pendulum(), "estimator", {"criterion": "weighted_trace"}, "estimator: "),
        (pendulum(), "estimator", {"mode": "exact"}, "estimator.mode: "),
        (pendulum(), "estimator", {"when_sets_do_not_meet": "ignore"}, "estimator.when_sets_do_not_meet: "),
        (gyro(), "rate", pendulum()["rate"], "its input"),
        (gyro(), "start", {"kind": "first_measurement"}, "bias_bound_deg_per_s is needed"),
        (gyro(), "start.P_diagonal", None, "start: give exactly one of P_diagonal, P"),
        (gyro(), "start.P_diagonal", [1.0, 1.0, 1.0, 1.0, 1.0, -1.0], "start.P_diagonal[5]: "),
        (gyro(), "start.attitude_qw_qx_qy_qz", [0.0, 0.0, 0.0, 0.0], "start.attitude_qw_qx_qy_qz: "),
        (gyro(), "truth", {"attitude_columns": ["a", "b", "c"]}, "truth.attitude_columns"),
    ],
)
def test_messages_name_file_and_key(tmp_path, tables, path, value, message):
    with pytest.raises(FileError) as caught:
        read(tmp_path, changed(tables, path, value))
    assert str(caught.value).startswith(str(tmp_path / "estimate.toml"))
    assert message in str(caught.value)


def test_all_that_is_wrong_is_said_at_once(tmp_path):
    tables = changed(changed(pendulum(), "flow.step_s", 0.0), "rate.columns", [1, 2, 3])
    with pytest.raises(FileError) as caught:
        read(tmp_path, tables)
    lines = str(caught.value).splitlines()
    assert any("flow.step_s" in line for line in lines)
    assert any("rate.columns" in line for line in lines)


def test_files_that_cannot_be_read(tmp_path):
    file = tmp_path / "estimate.toml"
    with pytest.raises(FileError, match=r"estimate.toml: no such file"):
        read_configuration(file)
    file.write_text("[flow\n", encoding="utf-8")
    with pytest.raises(FileError, match=r"estimate.toml: line 1, column 6: not TOML: the name of a table ends"):
        read_configuration(file)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(FileError, match=r"estimate.toml: not UTF-8"):
        read_configuration(file)


def test_nothing_changes_after_reading():
    configuration = Configuration.model_validate(pendulum())
    with pytest.raises(ValueError, match="frozen"):
        configuration.time_column = "t"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("directions.0.bound_deg", -7.0, r"more than 0, not -7\.0"),
        ("rate.bound_deg_per_s", 1e200, r"at most 1e\+40, not 1e\+200"),
        ("rate.bound_deg_per_s", 1e10, "at most 1000000000, not 10000000000"),
        ("directions.0.bound_deg", 1e-300, "0 or at least 1e-130"),
        ("flow.unknown_torque_n_m", 1e300, r"at most 1e\+40, not 1e\+300"),
        ("directions.0.name", "the Sun", "one word"),
        ("directions.0.name", "a,b", "one word"),
        ("directions.0.name", "rate", "measured angular velocity"),
    ],
)
def test_messages_name_value_and_limit(tmp_path, path, value, message):
    with pytest.raises(FileError, match=message):
        read(tmp_path, changed(pendulum(), path, value))


def without_a_largest_value(schema, place=""):
    """Where a number of a JSON schema has none."""
    if isinstance(schema, dict):
        limits = {"maximum", "exclusiveMaximum", "const", "enum"}
        if schema.get("type") in {"number", "integer"} and not limits & schema.keys():
            yield place
        schema = schema.items()
    elif isinstance(schema, list):
        schema = enumerate(schema)
    else:
        return
    for key, below in schema:
        yield from without_a_largest_value(below, f"{place}/{key}")


@pytest.mark.parametrize("model", [Configuration, Rule, Scenario])
def test_every_number_has_a_largest_value(model):
    assert list(without_a_largest_value(model.model_json_schema())) == []


@pytest.mark.parametrize(
    ("key", "value"),
    [("known_bias_deg_per_s", [0.0, -1e10, 0.0]), ("noise_deg_per_s", 1e10), ("drift_deg_per_s2", 1e10)],
)
def test_no_gyro_turns_so_fast(tmp_path, key, value):
    with pytest.raises(FileError, match=rf"flow\.{key}(\[1\])?: must be at (most|least) -?1000000000, not -?1"):
        read(tmp_path, changed(gyro(), f"flow.{key}", value))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e-320, 1e-200, 1e300])
def test_a_quaternion_of_any_length(tmp_path, size):
    tables = changed(gyro(), "start.attitude_qw_qx_qy_qz", [size, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(read(tmp_path, tables).start.build().attitude, np.eye(3))


# --- statements of time that a guarantee needs ------------------------------------------------------------------------


def guaranteed(tables):
    tables = {name: table for name, table in tables.items() if name != "start"}
    return tables | {"estimator": {"mode": "guaranteed"}, "reference_frame": "ENU"}


def test_windows_are_not_for_a_rigid_body():
    """Torques turn it between the measurements of its rate, and lines between them do not show that."""
    up = {"name": "up", "kind": "accelerometer", "columns": ["a", "b", "c"], "unit": "g"}
    up["bound_from"] = {"kind": "velocity_window", "windows_s": [2.0], "velocity_m_per_s": 0.01}
    with pytest.raises(
        ValueError,
        match=r"directions\[0\] \(up\): bound_from.kind = 'velocity_window' needs a gyro: .* torques turn a rigid "
        "body between .*. Use bound_from.kind = 'acceleration' or bound_deg, or flow.kind = 'gyro'",
    ):
        Configuration.model_validate(guaranteed(pendulum()) | {"directions": [up]})
    with_gyro = guaranteed(gyro()) | {"directions": [up]}
    assert Configuration.model_validate(with_gyro).directions[0].bound_from.velocity_m_per_s == 0.01


@pytest.mark.parametrize("bound", ["bound_deg_per_s", "bound_rad2_per_s2"])
def test_an_offset_of_a_measured_rate_belongs_to_its_bound(bound):
    tables = guaranteed(pendulum())
    value = 7.0 if bound == "bound_deg_per_s" else [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]]
    tables["rate"] = {"columns": ["wx", "wy", "wz"], bound: value, "time_offset_bound_s": 0.05}
    with pytest.raises(ValueError, match=f"rate.{bound} how much the rate changes in that time, and leave it out"):
        Configuration.model_validate(tables)
    of_direction = changed(guaranteed(pendulum()), "directions.0.time_offset_bound_s", 0.05)
    configuration = Configuration.model_validate(of_direction)
    assert configuration.time_offset_of(configuration.directions[0]) == 0.05


@pytest.mark.parametrize("place", ["directions.1", "flow"])
def test_an_offset_of_a_reference_in_columns_needs_how_fast_it_turns(place):
    tables = changed(guaranteed(gyro()), f"{place}.time_offset_bound_s", 1.0)
    with pytest.raises(
        ValueError, match=r"directions\[1\] \(mag\): reference_rate_deg_per_s: missing; with reference_"
    ):
        Configuration.model_validate(tables)
    configuration = Configuration.model_validate(changed(tables, "directions.1.reference_rate_deg_per_s", 0.126))
    assert [sensor.reference_rate for sensor in configuration.directions] == [0.0, pytest.approx(np.deg2rad(0.126))]
    # The modes of first order do not count offsets.
    Configuration.model_validate(changed(gyro(), f"{place}.time_offset_bound_s", 1.0))


def test_how_fast_a_reference_turns_is_of_columns():
    with pytest.raises(ValueError, match="reference_rate_deg_per_s: is of reference_columns"):
        Configuration.model_validate(changed(gyro(), "directions.0.reference_rate_deg_per_s", 0.1))


def test_the_sun_by_time_may_be_off():
    """By the almanac and by parallax, if nothing else is stated; an ellipsoid counts as the ball about it."""

    def added(**stated):
        sun = (
            {"name": "s", "columns": ["sx", "sy", "sz"]}
            | ({} if "bound_rad2" in stated else {"bound_deg": 1.0})
            | stated
        )
        sun["reference"] = {"kind": "sun", "time_zero": "2020-01-01T00:00:00Z"}
        tables = guaranteed(gyro()) | {"directions": [sun], "reference_frame": "J2000"}
        return np.rad2deg(Configuration.model_validate(tables).directions[0].added_angle)

    assert added() == pytest.approx(0.03)
    assert added(alignment_error_deg=0.1) == pytest.approx(0.13)
    assert added(reference_error_deg=0.0) == 0.0
    assert added(reference_error_deg=0.2) == pytest.approx(0.2)
    ball = (1e-4 * np.eye(3)).tolist()
    assert added(bound_rad2=ball) == pytest.approx(0.03)
    assert Configuration.model_validate(gyro()).directions[0].added_angle == 0.0


@pytest.mark.parametrize(
    ("says", "message"),
    [
        ({"declination_deg": 0.0}, r"directions\[1\] \(field\).reference: a rest phase without an attitude"),
        ({"attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0]}, None),
    ],
)
def test_a_reference_from_two_sensors_is_not_relaxed(says, message):
    """An accelerometer that is wrong in the rest makes the field wrong in every row, and itself in some."""
    phase = {"kind": "rest_phase", "from_s": 0.0, "to_s": 1.0} | says
    directions = [
        {"name": "up", "kind": "accelerometer", "columns": ["a", "b", "c"], "unit": "m/s^2", "bound_deg": 1.0},
        {"name": "field", "kind": "magnetometer", "columns": ["d", "e", "f"], "unit": "uT", "bound_deg": 1.0},
        pendulum()["directions"][0],
    ]
    directions[1]["reference"] = phase
    tables = guaranteed(gyro()) | {"directions": directions, "reference_frame": "ENU"}
    Configuration.model_validate(tables)
    tables["estimator"] = {"mode": "guaranteed", "policy": "relaxed", "most_wrong": 1}
    if message is None:
        Configuration.model_validate(tables)
        return
    with pytest.raises(ValueError, match=message):
        Configuration.model_validate(tables)


STILL_ON_EARTH = {"noise_deg_per_s": 0.001, "bias_deg_per_s": 0.001}
GROWING = STILL_ON_EARTH | {"noise_deg_per_s": 1.0, "noise_turn_deg": 1e-9, "anchor_s": 2.0}


@pytest.mark.parametrize(
    ("flow", "covers"),
    [
        (STILL_ON_EARTH, False),
        (STILL_ON_EARTH | {"noise_deg_per_s": 0.0042}, True),
        (STILL_ON_EARTH | {"bias_deg_per_s": 0.0042}, True),
        (STILL_ON_EARTH | {"earth_rate": "removed"}, True),
        # What changes with the pose is no bias that stands still.
        (STILL_ON_EARTH | {"bias_deg_per_s": 0.1, "estimate_bias": True}, False),
        # A noise that keeps its sign adds up: beside a bias of 0.001 it is 0.0032 deg/s, in 2 s 0.0064 deg.
        (STILL_ON_EARTH | {"noise_deg_per_s": 1.0, "increment_deg": 0.0063, "anchor_s": 2.0}, False),
        (STILL_ON_EARTH | {"noise_deg_per_s": 1.0, "increment_deg": 0.0065, "anchor_s": 2.0}, True),
        (STILL_ON_EARTH | {"noise_deg_per_s": 1.0, "noise_turn_deg": 0.0063, "anchor_s": 2.0}, False),
        (STILL_ON_EARTH | {"noise_deg_per_s": 1.0, "noise_turn_deg": 0.0065, "anchor_s": 2.0}, True),
        (GROWING | {"noise_turn_growth_deg_per_s": 0.0031}, False),
        (GROWING | {"noise_turn_growth_deg_per_s": 0.0033}, True),
        # Both hold, and so does the bound of an instant.
        (GROWING | {"noise_turn_growth_deg_per_s": 1.0, "increment_deg": 0.0063}, False),
        (GROWING | {"noise_turn_growth_deg_per_s": 1.0, "increment_deg": 0.0065}, True),
        (GROWING | {"noise_turn_growth_deg_per_s": 1.0, "noise_deg_per_s": 0.0031}, False),
    ],
)
def test_a_gyro_on_earth_shows_that_it_turns(flow, covers):
    tables = {"time_column": "t", "reference_frame": "ENU", "estimator": {"mode": "guaranteed"}} | {
        "flow": {"kind": "gyro", "columns": ["wx", "wy", "wz"]} | flow,
        "directions": [{"name": "sun", "columns": ["sx", "sy", "sz"], "reference": [1.0, 0.0, 0.0], "bound_deg": 7.0}],
    }
    if covers:
        Configuration.model_validate(tables)
    else:
        with pytest.raises(ValueError, match=r"by 0\.0042 deg/s, for which its bounds leave no room"):
            Configuration.model_validate(tables)
    # Stars stand still in axes that do not turn.
    Configuration.model_validate(tables | {"reference_frame": "J2000"})


def test_a_rule_is_of_the_earth():
    tables = hand_held().model_dump(mode="json", exclude_none=True)
    tables["gyro"] |= {"noise_deg_per_s": 0.0001, "bias_deg_per_s": 0.008}
    with pytest.raises(ValueError, match="gyro: in axes of the Earth"):
        Rule.model_validate(tables)
    tables["gyro"]["earth_rate"] = "removed"
    Rule.model_validate(tables)
    # Windows are up to 60 s: beside a bias of 0.008 deg/s they leave 0.034 deg to the Earth, with the scale error.
    del tables["gyro"]["earth_rate"]
    tables["gyro"]["noise_deg_per_s"] = 0.01
    tables["motion"]["windows_s"] = [2.0, 60.0]
    Rule.model_validate(tables | {"gyro": tables["gyro"] | {"increment_deg": 0.0342}})
    with pytest.raises(ValueError, match=r"leave no room \(0\.00815 over windows of 60 s\)"):
        Rule.model_validate(tables | {"gyro": tables["gyro"] | {"increment_deg": 0.009}})


def test_a_rule_has_room_for_the_earth_between_anchors():
    """In a long anchor what is stated of the noise for windows of 2 s adds up: the Earth's turn is in it as before."""
    rule = hand_held().model_dump(mode="json", exclude_none=True)
    rule["gyro"] |= {"noise_deg_per_s": 0.01, "bias_deg_per_s": 0.008, "increment_deg": 0.009}
    rule["motion"]["windows_s"] = [2.0]
    columns = {"columns": ["a", "b", "c"]}
    tables = {
        "time_column": "t",
        "flow": {"kind": "gyro"} | columns,
        "directions": [{"name": "up", "kind": "accelerometer", "unit": "m/s^2"} | columns],
        "estimator": {"mode": "guaranteed"},
    }
    still = np.tile([0.0, 0.0, 9.81], (1000, 1))
    log = Log(0.01 * np.arange(1000), still[:, None, :], still[:, None, :], np.zeros((1000, 3)))
    for anchor in (2.0, 60.0):
        stated = Configuration.model_validate(tables | {"rule": {"kind": "stated", "anchor_s": anchor} | rule})
        gyro = direction_rows(log, stated).gyro
        assert gyro.noise_angle(anchor, 0.0, anchor) >= np.deg2rad(0.0004 * anchor)


def test_a_growth_needs_what_it_is_added_to():
    tables = hand_held().model_dump(mode="json", exclude_none=True)
    del tables["gyro"]["noise_turn_deg"]
    with pytest.raises(ValueError, match="needs noise_turn_deg"):
        Rule.model_validate(tables)
    with pytest.raises(ValueError, match="needs noise_turn_deg"):
        Configuration.model_validate(changed(gyro(), "flow.noise_turn_growth_deg_per_s", 0.1))


@pytest.mark.parametrize("mode", ["paper", "first_order"])
def test_an_offset_of_the_truth_is_for_the_guaranteed_mode(tmp_path, mode):
    """In the others it counted for nothing, and nobody was told."""
    truth = {"attitude_columns": ["qw", "qx", "qy", "qz"]}
    tables = gyro() | {"estimator": {"mode": mode}, "truth": truth}
    assert read(tmp_path, tables).truth.time_offset_bound_s == 0.0
    tables["truth"] = truth | {"time_offset_bound_s": 0.01}
    with pytest.raises(FileError, match=r"truth\.time_offset_bound_s is for the guaranteed mode: .*truth\.error_deg"):
        read(tmp_path, tables)
    del tables["start"]
    tables["estimator"] = {"mode": "guaranteed"}
    tables["flow"]["bias_deg_per_s"] = 0.1
    assert read(tmp_path, tables).truth.time_offset_bound_s == 0.01


def test_a_rule_file_that_is_not_there_names_the_key(tmp_path):
    tables = gyro() | {"estimator": {"mode": "guaranteed"}, "rule": {"kind": "file", "file": "absent.toml"}}
    tables["directions"] = [{"kind": "accelerometer", "name": "up", "columns": ["ax", "ay", "az"], "unit": "m/s^2"}]
    tables["flow"] = {"kind": "gyro", "columns": ["wx", "wy", "wz"]}
    del tables["start"]
    with pytest.raises(FileError, match=r"estimate\.toml: rule\.file: .*absent\.toml"):
        read(tmp_path, tables)
