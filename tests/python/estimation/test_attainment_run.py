"""Each bound that becomes an input of the filter, alone: the truth comes to the edge, so that no term is lost.

Theory, sections 18.5 and 18.6. One source of error acts at its bound; a bound that leaves it out, or counts half of it,
is smaller than the error (`tests/mutations`).
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from elliptude import estimation, logs
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import angle_to_center
from elliptude.configuration import Configuration
from elliptude.configuration.references import sun_directions
from elliptude.configuration.rules import apply_rule, hand_held
from elliptude.configuration.rules.at_start import field_at_rest, up_at_rest
from elliptude.configuration.statements import SunByTime
from elliptude.estimation.direction_rows import direction_rows
from elliptude.estimation.given import filter_input
from elliptude.estimation.given.start import first_set
from elliptude.io.files import FileError
from elliptude.logs import Log
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

G = 9.80665
REFERENCES = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, -0.8]])
X = np.array([1.0, 0.0, 0.0])


def configured(flow, **changes):
    sensors = [
        {"name": name, "columns": list(columns), "reference": reference.tolist(), "bound_deg": np.rad2deg(0.02)}
        for name, columns, reference in zip(("one", "two"), ("abc", "def"), REFERENCES, strict=True)
    ]
    base = {
        "flow": {"kind": "gyro", "columns": ["x", "y", "z"], "noise_deg_per_s": 1e-6} | flow,
        "directions": sensors,
        "estimator": {"mode": "guaranteed"},
    }
    return Configuration.model_validate(base | changes)


def still_log(times, rates, measured):
    """A body at rest, with two exact directions in some rows."""
    count = len(times)
    directions = np.full((count, 2, 3), np.nan)
    directions[measured] = REFERENCES
    return Log(
        times=times,
        directions=directions,
        references=np.tile(REFERENCES, (count, 1, 1)),
        rates=rates,
        true_attitudes=np.tile(np.eye(3), (count, 1, 1)),
    )


# --- the gyro's flow --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("estimate_bias", [False, True])
def test_the_flows_noise_is_what_the_gyro_may_be_off(estimate_bias):
    """All errors make the rate look smaller: (1 - k) ω - b - ν. What the state's bias does not say of it is noise."""
    k, noise, bias = 0.1, 0.01, 0.02
    gyro = GyroBounds(noise=noise, bias=bias, drift=0.003, scale_error=k)
    fields = {"estimate_bias": estimate_bias, "bias_deg_per_s": 1.0, "angular_acceleration_deg_per_s2": 5.0}
    flow = configured(fields).flow
    core = filter_input.gyro_flow(gyro, flow)
    for true in (0.0, 0.5, 3.0):
        shown = (1.0 - k) * true - bias - noise
        if shown < 0.0:
            continue
        allowed = np.sqrt(np.max(np.diag(np.atleast_2d(core.noise)))) + core.scale * shown
        assert allowed == pytest.approx(true - shown - (bias if estimate_bias else 0.0))
    assert np.sqrt(np.max(np.diag(np.atleast_2d(core.drift)))) == pytest.approx(0.003 if estimate_bias else 0.0)
    assert core.angular_acceleration == pytest.approx(np.deg2rad(5.0))


@pytest.mark.parametrize("part", ["noise", "bias", "scale_error"])
def test_a_gyro_that_hides_a_turn(part):
    """It turns by (ν + b)/(1 - k), or at a rate of which a share k does not show; nothing else is measured."""
    times = np.linspace(0.0, 2.0, 41)
    k, true = 0.25, 0.04
    shown = {"noise": 0.0, "bias": 0.0, "scale_error": (1.0 - k) * true}[part]
    values = {"noise_deg_per_s": 1e-7, "bias_deg_per_s": 0.0, "scale_error": k}
    if part != "scale_error":
        values[f"{part}_deg_per_s"] = np.rad2deg(true * (1.0 - k))
    log = still_log(times, np.outer(np.full(41, shown), X), np.arange(41) == 0)
    log = dataclasses.replace(
        log, true_attitudes=Rotation.from_rotvec(np.outer(true * times, X)).as_matrix(), directions=log.directions
    )
    given = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1e-4] * 3 + [1e-8] * 3}
    estimated = estimation.estimate(log, configured(values, start=given))
    forms = estimated.result.forms
    assert np.nanmax(forms) <= 1.0
    assert forms[-1] > 0.2  # half of the error left out would be twice as far out


def test_a_scale_that_hides_how_the_axis_of_the_rate_moves():
    """The true rate is 1/(1 - k) times as long as what is shown, and turns the square of that beside its mean."""
    k, step, count = 0.3, 0.02, 5
    begin, end = np.deg2rad(500.0) * np.array([[1.0, 0.0, 0.0], [np.cos(0.5), np.sin(0.5), 0.0]])
    true = np.array([begin, end])[np.arange(count) % 2]
    times = step * np.arange(count)
    log = still_log(times, (1.0 - k) * true, np.ones(count, bool))
    configuration = configured({"scale_error": k})
    rows = direction_rows(log, configuration)
    flow = filter_input.filter_input(log, configuration, rows, None).flow
    fine = (np.arange(2000) + 0.5) / 2000
    turns = Rotation.from_rotvec(step / 2000 * (begin + np.outer(fine, end - begin)))
    whole = Rotation.identity()
    for turn in turns:
        whole = whole * turn
    beside = (whole.inv() * Rotation.from_rotvec(0.5 * step * (begin + end))).magnitude()
    allowed = step * np.sqrt(np.max(np.diag(np.atleast_2d(flow.noise))))
    assert 0.6 * allowed < beside <= allowed


@pytest.mark.parametrize("estimate_bias", [False, True])
def test_a_bias_that_drifts_to_the_end_of_the_log(estimate_bias):
    bias, drift = 0.01, 0.002
    times = np.linspace(0.0, 40.0, 401)
    biases = bias + drift * times
    measured = np.ones(401, bool) if estimate_bias else np.arange(401) == 0
    log = still_log(times, np.outer(biases, X), measured)
    log = dataclasses.replace(log, true_vectors=np.outer(biases, X) if estimate_bias else None)
    flow = {
        "bias_deg_per_s": np.rad2deg(bias),
        "drift_deg_per_s2": np.rad2deg(drift * 1.0001),
        "estimate_bias": estimate_bias,
    }
    if not estimate_bias:
        end = times <= 10.0
        log = dataclasses.replace(
            log, **{n: getattr(log, n)[end] for n in ("times", "directions", "references", "rates", "true_attitudes")}
        )
    estimated = estimation.estimate(log, configured(flow))
    forms = estimated.result.forms
    assert np.isfinite(forms).all()
    assert forms.max() <= 1.0
    assert (estimated.guaranteed.sets.claims == 0).all()


# --- from anchors -----------------------------------------------------------------------------------------------------


def test_where_a_recording_without_a_heading_begins():
    """A disc across the measured up with the radius of its bound: every way to be as far off as it may be is inside."""
    angle, up = 0.1, Rotation.from_rotvec([0.3, -0.5, 0.2]).apply([0.0, 0.0, 1.0])
    rows = SimpleNamespace(
        names=("up",),
        up_column=0,
        directions=up[None, None],
        angles=np.array([[angle]]),
        references=REFERENCES[None, :1],
    )
    configuration = SimpleNamespace(start=None, rule=object(), flow=None)
    start, counts = first_set(configuration, rows)
    assert counts
    np.testing.assert_allclose(start.attitude @ up, [0.0, 0.0, 1.0], atol=1e-12)
    for direction in np.linspace(0.0, np.pi, 7):
        across = Rotation.from_rotvec(direction * up).apply(np.cross(up, X) / np.linalg.norm(np.cross(up, X)))
        assert angle <= np.sqrt(across @ start.shape[:3, :3] @ across) < angle * (1.0 + 1e-6)


@pytest.mark.parametrize(("count", "speed"), [(20_001, 1.0), (2, 1e5), (2, 1.234e9), (200, 7e6)])
def test_rounding_of_many_steps_is_in_the_bound(count, speed):
    """With a perfect gyro what is left is the rounding of thousands of products, or of turns of many radians."""
    step = 2.0**-7  # so that times are exact
    rate = speed * np.array([0.7, -0.4, 0.55])
    gyro = GyroBounds(noise=0.0)
    turns = gyro.anchored_turns(step * np.arange(count), np.tile(rate, (count, 1)), 1e6)
    exact = step * (count - 1) * rate.astype(np.longdouble)
    angle = np.linalg.norm(exact)
    axis = exact / angle
    whole = 2.0 * np.longdouble("3.14159265358979323846264338327950288")
    left = angle - whole * np.round(angle / whole)
    found = turns.rates[-1].astype(np.longdouble) * (step * (count - 1))
    error = float(np.linalg.norm(found - left * axis))
    assert turns.turned[-1] == pytest.approx(float(angle), rel=1e-6)
    assert error <= filter_input._ROUNDING * (count - 1 + turns.turned[-1])
    if speed > 1.0:  # what a step adds would not do
        assert error > filter_input._ROUNDING * (count - 1)


def test_the_rounding_of_each_step_is_added(monkeypatch):
    """It is far below what any log shows, so its unit is taken to be larger: each step since the anchor adds one."""
    monkeypatch.setattr(filter_input, "_ROUNDING", 1e-5)
    times = np.linspace(0.0, 2.0, 101)
    log = still_log(times, np.zeros((101, 3)), np.zeros(101, bool))
    given = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1e-4] * 6}
    estimated = estimation.estimate(log, configured({"anchor_s": 10.0, "interval_rate": "mean_of_ends"}, start=given))
    widths = np.sqrt(estimated.guaranteed.sets.shapes[:, 0, 0])
    np.testing.assert_allclose(widths[[0, 50, 100]], 0.01 + np.array([0.0, 5e-4, 1e-3]), rtol=0.01)
    assert widths[100] >= 0.01 + 1e-3
    # And one for each radian: at 20 rad/s there are 40 of them beside the 100 steps.
    turning = still_log(times, np.tile([20.0, 0.0, 0.0], (101, 1)), np.zeros(101, bool))
    configuration = configured({"anchor_s": 10.0, "interval_rate": "mean_of_ends"}, start=given)
    shapes = estimation.estimate(turning, configuration).guaranteed.sets.shapes
    growth = (np.sqrt(shapes[:, 0, 0]) - 0.01) / np.maximum(widths - 0.01, 1e-9)
    np.testing.assert_allclose(growth[[50, 100]], 1.4, rtol=0.01)


@pytest.mark.parametrize("rate", [1e155, 1e200, 1e308])
def test_a_rate_beyond_all_numbers_says_nothing_of_the_turn(rate):
    times = np.linspace(0.0, 2.0, 101)
    rates = np.zeros((101, 3))
    rates[50] = [rate, -rate, 0.0]
    turns = GyroBounds(noise=0.1).anchored_turns(times, rates, 0.5)
    assert np.isfinite(turns.angles).all()
    assert (turns.angles[51:75] >= np.pi).all()
    assert (turns.angles[:49] < 0.1).all()
    assert (turns.angles[80:] < 0.1).all()
    log = still_log(times, rates, np.ones(101, bool))
    estimated = estimation.estimate(log, configured({"anchor_s": 0.5, "interval_rate": "mean_of_ends"}))
    assert np.isfinite(estimated.result.forms).all()
    assert estimated.result.forms.max() <= 1.0


# --- a rigid body -----------------------------------------------------------------------------------------------------


def log_of_wheels(gain=1e-3, count=21, step=0.1):
    """A body with a wheel that a motor turns ever faster by a torque that is known, which its momentum grows by."""
    times, spin = step * np.arange(count), gain / step * X

    def motion(t, y):
        vector, scalar, rate = y[:3], y[3], y[4:]
        change = 0.5 * np.append(scalar * rate + np.cross(vector, rate), -vector @ rate)
        return np.append(change, -np.cross(rate, rate + spin * t) - spin)

    found = solve_ivp(motion, (0.0, times[-1]), [0, 0, 0, 1, 0, 0, 0.5], "DOP853", times, rtol=1e-12, atol=1e-14)
    return Log(
        times=times,
        directions=np.full((count, 2, 3), np.nan),
        references=np.tile(REFERENCES, (count, 1, 1)),
        control_torques=np.tile(-spin, (count, 1)),
        wheel_momenta=np.outer(times, spin),
        true_attitudes=Rotation.from_quat(found.y[:4].T).as_matrix(),
        true_vectors=found.y[4:].T,
    )


def body_with_wheels(**flow):
    given = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "rate_rad_per_s": [0.0, 0.0, 0.5]}
    base = configured({}, start=given | {"P_diagonal": [1e-10] * 6}).model_dump(mode="json", exclude_unset=True)
    body = {"kind": "rigid_body", "inertia_kg_m2": [1.0, 1.0, 1.0], "step_s": 0.1}
    return Configuration.model_validate(base | {"flow": body | flow})


@pytest.mark.parametrize("unknown", [0.0, 1e-5])
def test_a_wheel_whose_momentum_changes_within_intervals(unknown):
    """Each row's momentum is that of the interval's end; what it was before is a torque of up to Ω ‖Δh‖."""
    log = log_of_wheels()
    fastest = np.linalg.norm(log.true_vectors, axis=1).max()
    flow = {"largest_rate_deg_per_s": np.rad2deg(1.001 * fastest), "unknown_torque_n_m": unknown}
    estimated = estimation.estimate(log, body_with_wheels(**flow))
    torque = np.sqrt(estimated.guaranteed.given.flow.unknown_torque[0, 0])
    assert torque == pytest.approx(unknown + 1.001 * fastest * 1e-3)
    forms = estimated.result.forms
    assert forms.max() <= 1.0
    assert forms[-1] > 0.1  # in the mean the momentum is half of its change away
    still = dataclasses.replace(log, wheel_momenta=np.ones((21, 3)))
    flow = estimation.estimate(still, body_with_wheels(unknown_torque_n_m=unknown)).guaranteed.given.flow
    np.testing.assert_allclose(flow.unknown_torque, unknown**2 * np.eye(3))


def test_a_wheel_whose_momentum_changes_needs_its_motors_torque_and_how_fast_the_body_turns():
    log, changes = log_of_wheels(), "the momentum changes, by up to 0.001 N m s from one row to the next; it needs flow"
    with pytest.raises(ValueError, match=rf"flow.wheel_momentum_columns: {changes}.largest_rate_deg_per_s, as"):
        estimation.estimate(log, body_with_wheels())
    with pytest.raises(
        ValueError, match=rf"{changes}.control_torque_columns, as the motors turn the body the other way"
    ):
        estimation.estimate(
            dataclasses.replace(log, control_torques=None), body_with_wheels(largest_rate_deg_per_s=40.0)
        )


def test_a_stamp_that_is_off_by_how_fast_a_body_turns_at_most():
    log = still_log(np.arange(5.0), None, np.ones(5, bool))
    fields = body_with_wheels(largest_rate_deg_per_s=10.0).model_dump(mode="json", exclude_unset=True)
    fields["directions"][1]["time_offset_bound_s"] = 0.3
    rows = direction_rows(log, Configuration.model_validate(fields))
    np.testing.assert_allclose(rows.angles, np.tile([0.02, 0.02 + 0.3 * np.deg2rad(10.0)], (5, 1)))
    # A sample that is 0.2 s from its row turns by as much more.
    moved = dataclasses.replace(log, offsets=np.array([[0.0, -0.2], *np.zeros((4, 2))]))
    own = direction_rows(moved, Configuration.model_validate(fields))
    np.testing.assert_allclose(own.angles[:2, 1], 0.02 + np.array([0.5, 0.3]) * np.deg2rad(10.0))
    np.testing.assert_array_equal(own.angles[:, 0], rows.angles[:, 0])
    del fields["flow"]["largest_rate_deg_per_s"]
    with pytest.raises(ValueError, match="'two': time_offset_bound_s of a rigid body needs flow"):
        direction_rows(log, Configuration.model_validate(fields))


# --- directions -------------------------------------------------------------------------------------------------------


def test_a_stamp_that_is_off_by_what_is_known_of_the_gyro():
    """The known bias is taken away; the rest shows (1 - k) of the rate less the noise, and may change."""
    k, noise, true, acceleration, offset, step = 0.2, 0.01, 0.5, 0.3, 0.02, 0.05
    bias = np.array([0.1, -0.2, 0.05])
    shown = (1.0 - k) * true - noise
    times = step * np.arange(20)
    log = still_log(times, np.tile(bias + shown * X, (20, 1)), np.ones(20, bool))
    flow = {
        "noise_deg_per_s": np.rad2deg(noise),
        "scale_error": k,
        "known_bias_deg_per_s": np.rad2deg(bias).tolist(),
        "angular_acceleration_deg_per_s2": np.rad2deg(acceleration),
        "time_offset_bound_s": offset,
    }
    rows = direction_rows(log, configured(flow))
    # Between samples the rate may rise, and fall again, by half a step's acceleration.
    expected = 0.02 + offset * (true + 0.5 * acceleration * step)
    np.testing.assert_allclose(rows.angles[2:-2], expected, rtol=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_reference_that_turns_while_a_stamp_is_off(sign):
    """A body at rest, a reference in columns for the stamp: what is measured is that of a time that is off."""
    turning, offset, of_gyro, bound = 2.2e-3, 0.7, 0.3, np.deg2rad(0.02)
    times = np.arange(60.0)

    def reference(at):
        return np.column_stack([np.cos(turning * at), np.sin(turning * at), 0.0 * at])

    measured = reference(times + sign * ((offset + of_gyro) + bound / turning))
    log = still_log(times, np.zeros((60, 3)), np.ones(60, bool))
    log = dataclasses.replace(log, directions=measured[:, None], references=reference(times)[:, None])
    fields = configured({"time_offset_bound_s": of_gyro}).model_dump(mode="json", exclude_unset=True)
    fields["directions"] = [
        {
            "name": "field",
            "columns": ["a", "b", "c"],
            "reference_columns": ["d", "e", "f"],
            "reference_rate_deg_per_s": np.rad2deg(turning),
            "bound_deg": np.rad2deg(bound),
            "time_offset_bound_s": offset,
        }
    ]
    rows = direction_rows(log, Configuration.model_validate(fields))
    errors = np.linalg.norm(np.cross(rows.directions[1:-1, 0], rows.references[1:-1, 0]), axis=1)
    # The gyro's noise of 1e-6 deg/s counts in that time, too.
    assert (errors <= rows.angles[1:-1, 0]).all()
    assert (errors >= 0.999 * rows.angles[1:-1, 0]).all()


def test_the_sun_moves_while_a_stamp_is_off():
    """Where the Earth is nearest to it the Sun moves by 1.02 degrees a day."""
    offset, times = 7200.0, 60.0 * np.arange(360.0)
    shown = SunByTime.model_validate({"kind": "sun", "time_zero": "2020-01-05T00:00:00Z"})
    log = still_log(times, np.zeros((360, 3)), np.ones(360, bool))
    log = dataclasses.replace(
        log,
        directions=sun_directions(shown, times + offset)[:, None],
        references=sun_directions(shown, times)[:, None],
    )
    fields = configured({"noise_deg_per_s": 1e-9}).model_dump(mode="json", exclude_unset=True)
    fields["reference_frame"] = "J2000"
    sun = {"name": "sun", "columns": ["a", "b", "c"], "bound_deg": 1e-6, "reference_error_deg": 0.0}
    sun |= {"reference": shown.model_dump(mode="json"), "time_offset_bound_s": offset}
    rows = direction_rows(log, Configuration.model_validate(fields | {"directions": [sun]}))
    within = slice(130, 230)
    errors = np.linalg.norm(np.cross(rows.directions[within, 0], rows.references[within, 0]), axis=1)
    assert (errors <= rows.angles[within, 0]).all()
    assert (errors >= 0.95 * rows.angles[within, 0]).all()


def test_an_ellipsoid_counts_by_its_longest_axis():
    log = still_log(np.arange(3.0), np.zeros((3, 3)), np.ones(3, bool))
    fields = configured({}).model_dump(mode="json", exclude_unset=True)
    del fields["directions"][0]["bound_deg"]
    fields["directions"][0]["bound_rad2"] = np.diag([1e-4, 9e-4, 4e-4]).tolist()
    np.testing.assert_allclose(direction_rows(log, Configuration.model_validate(fields)).angles[:, 0], 0.03)


# --- the rule ---------------------------------------------------------------------------------------------------------


def rule_with(**parts):
    """The rule for a sensor in the hand with all errors zero but those given, as `accelerometer__error`."""
    rule = hand_held()
    zero = {
        "accelerometer": {"gravity_m_per_s2": G, "gravity_error_m_per_s2": 0.0, "error_m_per_s2": 0.0,
                          "averaged_error_m_per_s2": 0.0, "scale_error": 0.0, "time_offset_bound_s": 0.0},
        "magnetometer": {"disturbance_ut": 0.0, "error_ut": 0.0, "averaged_error_ut": 0.0, "scale_error": 0.0,
                         "delay_s": 0.0, "time_offset_bound_s": 0.0},
        "rest": {"velocity_m_per_s": 0.0},
        "gyro": {"noise_deg_per_s": 0.0, "bias_deg_per_s": 0.0, "scale_error": 0.0, "increment_deg": None},
    }  # fmt: skip
    for name, value in parts.items():
        part, field = name.split("__")
        zero[part][field] = value
    return rule.model_copy(
        update={part: getattr(rule, part).model_copy(update=changes) for part, changes in zero.items()}
    )


FIELD = np.array([0.0, 18.0, -42.0])
STRENGTH = float(np.linalg.norm(FIELD))


@pytest.mark.parametrize(
    "parts",
    [
        {"rest__velocity_m_per_s": 0.5},
        {"accelerometer__averaged_error_m_per_s2": 0.25},
        {"magnetometer__averaged_error_ut": 3.0},
        {"magnetometer__scale_error": 0.1},
        {"magnetometer__scale_error": 0.1, "magnetometer__error_ut": 3.0, "magnetometer__averaged_error_ut": 3.0},
    ],
    ids=["moved", "accelerometer", "magnetometer", "scale", "scale of error"],
)
def test_the_reference_field_is_off_by_each_error_alone(parts):
    """Gravity in the mean is tilted in the plane of up and the field, or the field is shown too short."""
    rule = rule_with(**parts)
    times = np.linspace(0.0, 4.0, 401)
    # 0.5 m/s one way and then the other in 4 s is 0.25 m/s² in the mean.
    tilt = 0.25 if "rest__velocity_m_per_s" in parts or "accelerometer__averaged_error_m_per_s2" in parts else 0.0
    angle = np.arcsin(tilt / G)
    force = np.sqrt(G**2 - tilt**2) * np.array([0.0, np.sin(angle), np.cos(angle)])
    shown = FIELD
    if tilt == 0.0:
        k, e = parts.get("magnetometer__scale_error", 0.0), parts.get("magnetometer__averaged_error_ut", 0.0)
        shown = FIELD * ((1.0 - k) * STRENGTH - e) / STRENGTH
    up = up_at_rest(rule, times, np.tile(force, (401, 1)))
    reference, error = field_at_rest(rule, up, times, np.tile(shown, (401, 1)))
    off = np.linalg.norm(reference - FIELD)
    assert 0.999 * error <= off <= error * (1.0 + 1e-9)


def turning_recording(reference_field, field, *, late=0.0, speed=0.5):
    """Two seconds and a half at rest, and then a turn about the vertical, with a field that is another then."""
    times = 0.005 * np.arange(1201)

    def heading(t):
        return 0.5 * speed * np.clip(t - 2.6, 0.0, None) ** 2

    rates = np.zeros((1201, 3))
    rates[:, 2] = speed * np.clip(times - 2.6, 0.0, None)
    attitudes = Rotation.from_rotvec(np.outer(heading(times), [0.0, 0.0, 1.0]))
    seen = Rotation.from_rotvec(np.outer(heading(times - late), [0.0, 0.0, 1.0])).inv()
    fields = np.where(times[:, None] < 2.6, reference_field, seen.apply(field))
    return times, rates, np.tile([0.0, 0.0, G], (1201, 1)), fields, attitudes


def assert_field_holds(ruled, attitudes, true, rows, share):
    directions = attitudes.inv().apply(true / np.linalg.norm(true))
    cross = np.linalg.norm(np.cross(ruled.field.directions, directions), axis=1)
    errors = np.arctan2(cross, np.sum(ruled.field.directions * directions, axis=1))
    assert np.isfinite(ruled.field.angles[rows]).all()
    assert (errors <= ruled.field.angles * (1.0 + 1e-9))[rows].all()
    assert (errors > share * ruled.field.angles)[rows].any()


def test_what_is_left_of_a_delay_of_the_field():
    """12 ms with rows every 5 ms: 2 ms are left, by which the body turns on."""
    rule = rule_with(
        magnetometer__delay_s=0.012, magnetometer__averaged_error_ut=1e-3, magnetometer__error_ut=1e-3,
        accelerometer__averaged_error_m_per_s2=1e-6, accelerometer__error_m_per_s2=1e-6, magnetometer__window_s=0.05,
    )  # fmt: skip
    field = np.array([0.0, 30.0, 0.0])
    times, rates, forces, fields, attitudes = turning_recording(field, field, late=0.012)
    ruled = apply_rule(rule, times, rates, forces, fields)
    assert_field_holds(ruled, attitudes, field, slice(900, 1150), 0.8)


def test_the_reference_fields_error_counts_in_motion():
    """At rest the field is shown as it is but for an error, and in motion the other way."""
    error, strength = 2.0, 30.0
    rule = rule_with(
        magnetometer__averaged_error_ut=error, magnetometer__error_ut=error, magnetometer__window_s=0.05,
        accelerometer__averaged_error_m_per_s2=1e-6, accelerometer__error_m_per_s2=1e-6,
    )  # fmt: skip
    true = np.array([0.0, strength, 0.0])
    # The reference is what is shown at rest; what is shown later is off by the same, the other way: twice the error.
    away = np.array([0.0, 0.0, 1.0])
    times, rates, forces, fields, attitudes = turning_recording(true + error * away, true - error * away)
    ruled = apply_rule(rule, times, rates, forces, fields)
    shown_reference = ruled.field_reference
    assert_field_holds(ruled, attitudes, shown_reference, slice(900, 1150), 0.9)
    assert angle_to_center(strength, strength, error)[0] < 0.6 * np.nanmax(ruled.field.angles[900:1150])


# --- rows in time order -----------------------------------------------------------------------------------------------


def test_a_gap_is_found_wherever_batches_end(tmp_path, monkeypatch):
    """Also exactly between two of them."""
    gyro = {"kind": "gyro", "columns": ["gx", "gy", "gz"], "unit": "rad/s", "noise_deg_per_s": 1.0, "delay_s": 0.004}
    up = {"name": "up", "kind": "accelerometer", "columns": ["ax", "ay", "az"], "unit": "m/s^2", "bound_deg": 5.0}
    start = {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [0.1] * 6}
    configuration = Configuration.model_validate(
        {
            "time_column": "t",
            "reference_frame": "ENU",
            "flow": gyro,
            "directions": [up],
            "start": start,
            "timing": {"largest_gap_s": 0.1},
        }
    )
    monkeypatch.setattr("elliptude.io.readers.text.csv.BATCH_BYTES", 256)
    path = tmp_path / "log.csv"
    for gap in (None, *range(1, 40)):
        times = 0.02 * np.arange(40)
        if gap is not None:
            times[gap:] += 0.2
        rows = [f"{time:.3f},0.1,0.2,0.3,0.0,0.0,9.8" for time in times]
        path.write_text("\n".join(["t,gx,gy,gz,ax,ay,az", *rows]) + "\n")
        if gap is None:
            assert len(logs.read_log(path, configuration).times) > 30
        else:
            with pytest.raises(FileError, match=r"0\.22 s after the sample of .* before it"):
                logs.read_log(path, configuration)
