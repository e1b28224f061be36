"""Passes backward in time against truths that other code integrated forward: a wrong sign or row is seen."""

import dataclasses

import elliptude as el
import numpy as np
import pytest
from elliptude.configuration import Configuration
from elliptude.estimation.guaranteed_run import run_filter, run_guaranteed
from elliptude.logs import Log
from elliptude.smoothing.mirror import mirrored, mirrored_flow, mirrored_potential, mirrored_set, turned_round
from reference import so3
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

INERTIA = np.array([[1.0, 0.1, -0.05], [0.1, 2.0, 0.08], [-0.05, 0.08, 2.6]])
STEP, COUNT = 0.05, 30
FIRST = 3.0
"""s; not 0, so that a potential that depends on time is seen at the right one."""
ORBIT_RATE = 0.9
TORQUE = 2e-4


def body_log(seed=0):
    """A body under gravity gradient, control, a wheel and an unknown torque that uses up its bound, and its truth."""
    draws = np.random.default_rng(seed)
    times = FIRST + STEP * np.arange(COUNT)
    controls, wheels = 0.5 * draws.standard_normal((COUNT, 3)), 0.5 * draws.standard_normal((COUNT, 3))
    pushes = draws.standard_normal((COUNT, 3))
    pushes *= TORQUE / np.linalg.norm(pushes, axis=1, keepdims=True)

    def motion(t, y, k):
        c, w = y[:9].reshape(3, 3), y[9:]
        radial = c.T @ [np.cos(ORBIT_RATE * t), np.sin(ORBIT_RATE * t), 0.0]
        torque = 3.0 * ORBIT_RATE**2 * np.cross(radial, INERTIA @ radial) + controls[k] + pushes[k]
        change = np.linalg.solve(INERTIA, torque - np.cross(w, INERTIA @ w + wheels[k]))
        return np.concatenate([(c @ so3.hat(w)).ravel(), change])

    states = [np.concatenate([Rotation.random(rng=draws).as_matrix().ravel(), [0.3, -0.5, 0.4]])]
    for k in range(1, COUNT):
        found = solve_ivp(motion, times[k - 1 : k + 1], states[-1], args=(k,), method="DOP853", rtol=1e-12, atol=1e-13)
        states.append(found.y[:, -1])
    states = np.array(states)
    attitudes = el.renormalized(states[:, :9].reshape(-1, 3, 3))
    return Log(
        times=times,
        directions=np.full((COUNT, 1, 3), np.nan),
        references=np.tile([1.0, 0.0, 0.0], (COUNT, 1, 1)),
        control_torques=controls,
        wheel_momenta=wheels,
        true_attitudes=attitudes,
        true_vectors=states[:, 9:],
    )


def body_configuration(log):
    (w, x, y, z) = el.quaternion_from_rotation(log.true_attitudes[0])
    return Configuration.model_validate(
        {
            "flow": {
                "kind": "rigid_body",
                "inertia_kg_m2": INERTIA.tolist(),
                "step_s": STEP,
                "potential": {"kind": "gravity_gradient", "orbit_rate_rad_per_s": ORBIT_RATE},
                "unknown_torque_n_m": TORQUE,
                "control_torque_columns": ["a", "b", "c"],
                "wheel_momentum_columns": ["d", "e", "f"],
            },
            "directions": [{"name": "sun", "columns": ["g", "h", "i"], "reference": [1.0, 0.0, 0.0], "bound_deg": 1.0}],
            "estimator": {"mode": "guaranteed"},
            "start": {
                "kind": "given",
                "attitude_qw_qx_qy_qz": [w, x, y, z],
                "rate_rad_per_s": log.true_vectors[0].tolist(),
                "P_diagonal": [1e-10] * 6,
            },
        }
    )


def body_run(log, configuration):
    """The log's run, where the wheels' momentum changes at rows alone, so that none of it is an unknown torque."""
    run = run_guaranteed(dataclasses.replace(log, wheel_momenta=None), configuration)
    given = dataclasses.replace(run.given, motion=run.given.motion | {"wheel_momentum": log.wheel_momenta})
    return dataclasses.replace(run, given=given, sets=run_filter(given, run.start, configuration, None))


def body_forms(log, configuration, run, given):
    """Where the truth is in the sets of a pass backward from next to the truth at the last row."""
    truth = el.StateEllipsoid(log.true_attitudes[-1], -log.true_vectors[-1], 1e-10 * np.eye(6))
    sets = turned_round(run_filter(given, truth, configuration, None), log.times)
    assert np.nanmax(sets.extents().largest_angles) < 0.01  # so small that nothing wrong fits in
    return sets.forms(log.true_attitudes, log.true_vectors)


def test_a_rigid_body_backward():
    log = body_log()
    configuration = body_configuration(log)
    run = body_run(log, configuration)
    assert np.max(run.sets.forms(log.true_attitudes, log.true_vectors)) <= 1.0
    given = mirrored(run, configuration).given
    forms = body_forms(log, configuration, run, given)
    assert np.isfinite(forms).all()
    assert np.max(forms) <= 1.0
    # The unknown torque goes where its bound is needed.
    without = el.GuaranteedRigidBodyFlow(given.flow.body, given.flow.potential, step=STEP)
    assert np.nanmax(body_forms(log, configuration, run, dataclasses.replace(given, flow=without))) > 1.0


@pytest.mark.parametrize("wrong", ["control sign", "control row", "wheel sign", "wheel row", "orbit", "times"])
def test_every_sign_and_row_of_a_rigid_body_matters(wrong):
    log = body_log(1)
    configuration = body_configuration(log)
    run = body_run(log, configuration)
    given = mirrored(run, configuration).given
    motion = dict(given.motion)
    name = "control_torque" if wrong.startswith("control") else "wheel_momentum"
    if wrong.endswith("sign"):
        motion[name] = -motion[name]
    elif wrong.endswith("row"):
        motion[name] = np.roll(motion[name], -1, axis=0)
    given = dataclasses.replace(given, motion=motion)
    if wrong == "orbit":
        given = dataclasses.replace(given, flow=run.given.flow)
    elif wrong == "times":
        given = dataclasses.replace(given, times=given.times + 0.5)
    assert np.nanmax(body_forms(log, configuration, run, given)) > 1.0


def test_the_mirrored_potential_at_minus_t():
    body = el.RigidBody(INERTIA)
    orbit = Rotation.from_rotvec([0.3, 0.2, -0.5]).as_matrix()
    whole = el.SumPotential(
        [
            el.GravityGradient(body, 0.7, orbit),
            el.UniformGravity(1.0, 9.8, [0.1, 0.0, 0.2]),
            el.FreeBody(),
            el.LinearPotential([0.1, 0.2, 0.3], [1.0, 0.0, 0.0], [0.0, 0.3, 0.4]),
            el.QuadraticPotential(INERTIA, [0.0, 1.0, 0.0], [0.6, 0.0, 0.0]),
            el.StatedTorque(el.GravityGradient(body, 0.5, orbit), rate=2.0, error=0.1, curvature=3.0),
        ]
    )
    turned = mirrored_potential(whole)
    for time, attitude in zip((-2.0, 0.3, 4.0), Rotation.random(3, rng=2).as_matrix(), strict=True):
        np.testing.assert_allclose(turned.torque(attitude, time), whole.torque(attitude, -time), atol=1e-13)
        assert np.linalg.norm(turned.torque(attitude, time) - whole.torque(attitude, time)) > 1e-3
    stated = turned.potentials[-1]
    assert (stated.rate, stated.error, stated.curvature) == (2.0, 0.1, 3.0)
    jacobian = whole.potentials[-1].torque_jacobian(orbit, -1.0)
    np.testing.assert_array_equal(stated.torque_jacobian(orbit, 1.0), jacobian)


def test_a_potential_of_ones_own_is_refused():
    own = el.GradientPotential(lambda c, t: 0.0, lambda c, t: np.zeros((3, 3)))
    with pytest.raises(ValueError, match="backward in time, and GradientPotential does not say"):
        mirrored_potential(own)
    with pytest.raises(ValueError, match="backward in time"):
        mirrored_potential(el.SumPotential([el.FreeBody(), own]))


# --- gyro -------------------------------------------------------------------------------------------------------------

NOISE, BIAS, DRIFT, SCALE = 2e-4, 3e-3, 2e-3, 5e-3
KNOWN = np.array([0.05, -0.03, 0.02])
"""rad/s; a bias that is stated, beside what is left of it."""


def gyro_log(interval_rate, seed=0, count=60, step=0.05, scale=SCALE):
    """A gyro whose errors use up their bounds: rates constant between samples, or on straight lines."""
    draws = np.random.default_rng(seed)
    times = FIRST + step * np.arange(count)
    true = 0.8 * np.sin(np.outer(times, [0.7, 1.1, 1.9]) + draws.uniform(0.0, 6.0, 3))
    attitudes = [Rotation.random(rng=draws).as_matrix()]
    for k in range(count - 1):
        pieces = 1 if interval_rate == "first_sample" else 400
        shares = np.zeros(1) if pieces == 1 else (np.arange(pieces) + 0.5) / pieces
        attitude = attitudes[-1]
        for share in shares:
            attitude = attitude @ so3.exp(step / pieces * ((1.0 - share) * true[k] + share * true[k + 1]))
        attitudes.append(attitude)
    axis = np.array([0.6, 0.0, 0.8])
    biases = (BIAS + DRIFT * (times - times[0]))[:, None] * axis
    k = scale * Rotation.random(rng=draws).as_matrix()
    noise = draws.standard_normal((count, 3))
    noise *= NOISE / np.linalg.norm(noise, axis=1, keepdims=True)
    return Log(
        times=times,
        directions=np.full((count, 1, 3), np.nan),
        references=np.tile([0.0, 0.0, 1.0], (count, 1, 1)),
        rates=true + true @ k.T + KNOWN + biases + noise,
        true_attitudes=np.array(attitudes),
        true_vectors=biases,
    )


def gyro_configuration(log, interval_rate, estimate_bias, anchor=None, scale=SCALE):
    flow = {
        "kind": "gyro",
        "columns": ["x", "y", "z"],
        "interval_rate": interval_rate,
        "noise_deg_per_s": np.rad2deg(NOISE),
        "bias_deg_per_s": np.rad2deg(BIAS),
        "known_bias_deg_per_s": np.rad2deg(KNOWN).tolist(),
        "drift_deg_per_s2": np.rad2deg(DRIFT),
        "scale_error": scale,
        "estimate_bias": estimate_bias,
    }
    if anchor is not None:
        flow |= {"anchor_s": anchor}
    return Configuration.model_validate(
        {
            "flow": flow,
            "directions": [{"name": "up", "columns": ["g", "h", "i"], "reference": [0.0, 0.0, 1.0], "bound_deg": 1.0}],
            "estimator": {"mode": "guaranteed"},
            "start": {
                "kind": "given",
                "attitude_qw_qx_qy_qz": el.quaternion_from_rotation(log.true_attitudes[0]).tolist(),
                "P_diagonal": [1e-10] * 3 + [(1.1 * BIAS) ** 2] * 3,
            },
        }
    )


def gyro_sets(log, configuration, given, *, bias=True):
    vector = -log.true_vectors[-1] if bias else np.zeros(3)
    truth = el.StateEllipsoid(log.true_attitudes[-1], vector, 1e-10 * np.eye(6))
    return turned_round(run_filter(given, truth, configuration, None), log.times)


@pytest.mark.parametrize("interval_rate", ["first_sample", "mean_of_ends"])
@pytest.mark.parametrize("seed", range(3))
def test_a_gyro_with_an_estimated_bias_backward(interval_rate, seed):
    log = gyro_log(interval_rate, seed)
    configuration = gyro_configuration(log, interval_rate, estimate_bias=True)
    run = run_guaranteed(log, configuration)
    assert np.max(run.sets.forms(log.true_attitudes, log.true_vectors)) <= 1.0
    given = mirrored(run, configuration).given
    forms = gyro_sets(log, configuration, given).forms(log.true_attitudes, log.true_vectors)
    assert np.isfinite(forms).all()
    assert np.max(forms) <= 1.0
    wrong_row = np.roll(given.motion["gyro"], 1, axis=0)
    for gyro in (-given.motion["gyro"], wrong_row):
        sets = gyro_sets(log, configuration, dataclasses.replace(given, motion={"gyro": gyro}))
        assert np.nanmax(sets.forms(log.true_attitudes)) > 1.0
    # The bias has the other sign, too.
    truth = el.StateEllipsoid(log.true_attitudes[-1], log.true_vectors[-1], 1e-10 * np.eye(6))
    sets = turned_round(run_filter(given, truth, configuration, None), log.times)
    assert np.nanmax(sets.forms(log.true_attitudes)) > 1.0


@pytest.mark.parametrize(
    ("forward", "backward"),
    [("first_sample", "last_sample"), ("last_sample", "first_sample"), ("mean", "mean"), ("mean_of_ends",) * 2],
)
def test_a_rate_of_the_beginning_is_one_of_the_end_backward(forward, backward):
    flow = el.GuaranteedGyroFlow(
        np.diag([1.0, 2.0, 3.0]),
        np.diag([4.0, 5.0, 6.0]),
        scale=0.1,
        angular_acceleration=0.2,
        interval_rate=forward,
        longest_interval=0.3,
        largest_rate=0.4,
    )
    found = mirrored_flow(flow)
    assert found.interval_rate == backward
    np.testing.assert_array_equal(found.noise, flow.noise)
    np.testing.assert_array_equal(found.drift, flow.drift)
    for name in ("scale", "angular_acceleration", "longest_interval", "largest_rate"):
        assert getattr(found, name) == getattr(flow, name)


@pytest.mark.parametrize("scale", [SCALE, 0.0])
def test_turns_from_anchors_backward(scale):
    log = gyro_log("mean_of_ends", scale=scale)
    configuration = gyro_configuration(log, "mean_of_ends", estimate_bias=False, anchor=0.7, scale=scale)
    run = run_guaranteed(log, configuration)
    back = mirrored(run, configuration)
    turns = back.given.turns
    attitudes = log.true_attitudes[::-1]
    assert turns.anchors[0] == -1
    assert (np.diff(turns.anchors[1:]) >= 0).all()
    errors = np.array(
        [
            np.linalg.norm(so3.log(so3.exp(turns.vectors[k]).T @ attitudes[turns.anchors[k]].T @ attitudes[k]))
            for k in range(1, len(attitudes))
        ]
    )
    shares = errors / turns.angles[1:]
    assert np.max(shares) <= 1.0
    # The bias is largest at the end, by three times: with a drift that counts from there, the bound would be broken.
    assert scale > 0.0 or np.max(shares[:10]) > 0.8
    sets = gyro_sets(log, configuration, back.given, bias=False)
    assert np.nanmax(sets.forms(log.true_attitudes)) <= 1.0


def test_the_drift_counts_from_the_first_row():
    log = gyro_log("mean_of_ends")
    configuration = gyro_configuration(log, "mean_of_ends", estimate_bias=False, anchor=0.7)
    back = mirrored(run_guaranteed(log, configuration), configuration)
    # By the first anchor backward, the bias may be larger by the drift over the whole log.
    late, early = back.given.turns.angles[10], back.given.turns.angles[-1]
    rows = back.given.turns.anchors
    spans = back.given.times - back.given.times[rows]
    assert late / spans[10] > early / spans[-1] + 0.5 * DRIFT * (log.times[-1] - log.times[0])


def test_a_gap_is_one_backward():
    log = gyro_log("mean_of_ends")
    keep = np.ones(len(log.times), dtype=bool)
    keep[20:30] = False
    names = ("times", "directions", "references", "rates", "true_attitudes", "true_vectors")
    log = dataclasses.replace(log, **{name: getattr(log, name)[keep] for name in names})
    for anchor in (None, 0.7):
        configuration = gyro_configuration(log, "mean_of_ends", estimate_bias=False, anchor=anchor)
        run = run_guaranteed(log, configuration)
        sets = gyro_sets(log, configuration, mirrored(run, configuration).given, bias=False)
        known = np.isfinite(sets.shapes[:, 0, 0])
        # Nothing is known of the rate in it, so nothing of the attitude before it.
        assert known[20:].all()
        assert not known[:20].any()
        assert np.nanmax(sets.forms(log.true_attitudes)) <= 1.0


def test_a_set_as_the_start_in_the_other_direction():
    log = body_log()
    configuration = body_configuration(log)
    found = body_run(log, configuration).sets
    start = mirrored_set(found, -1, estimates_vector=True)
    inside = start.quadratic_form(log.true_attitudes[-1], -log.true_vectors[-1])
    assert inside == pytest.approx(found.forms(log.true_attitudes, log.true_vectors)[-1], rel=1e-6)
    assert mirrored_set(dataclasses.replace(found, shapes=np.full_like(found.shapes, np.nan)), -1, True) is None
