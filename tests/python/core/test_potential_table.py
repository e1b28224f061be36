"""Every potential of the core is wherever one is to be found: a new one fails here until it is.

What it must be like is in other tests: its torque beside the reference in `test_dynamics.py`, its sets beside true
motions in `test_guaranteed.py` and `test_own_potentials.py`.
"""

import json
import pickle
from typing import get_args

import elliptude as el
import numpy as np
import pytest
from elliptude import _core, _potentials
from elliptude.configuration import potentials as configured
from elliptude.simulation import potentials as simulated
from inputs import rotation

BODY = el.RigidBody([0.13, 0.28, 0.17])
MADE_OF_OTHERS = {"SumPotential", "GradientPotential", "StatedTorque"}
"""Made of other potentials or of functions of the user's: they have no row of numbers."""
CONFIGURED = {
    "free": {},
    "uniform_gravity": {"mass_kg": 1.5, "gravity_m_per_s2": 9.8, "center_of_mass_m": [0.1, -0.2, 0.3]},
    "gravity_gradient": {"orbit_rate_rad_per_s": 0.2},
    "linear": {"moment_n_m": [0.1, 0.2, -0.3], "direction": [1.0, 2.0, 0.0], "turn_rad_per_s": [0.0, 0.0, 0.4]},
    "quadratic": {
        "matrix_n_m": [[1.0, 0.1, 0.0], [0.1, 2.0, 0.3], [0.0, 0.3, 1.5]],
        "direction": [1.0, 2.0, 0.0],
        "turn_rad_per_s": [0.0, 0.0, 0.4],
    },
}
UNITS = ("_kg", "_m_per_s2", "_rad_per_s", "_n_m", "_m")


def models(module, union):
    """The models of potentials in a module by their kind."""
    return {get_args(model.model_fields["kind"].annotation)[0]: getattr(module, model.__name__) for model in union}


def of_configuration():
    return models(configured, get_args(configured.AnyTerm))


def of_scenarios():
    return models(simulated, get_args(get_args(simulated.Potential)[0]))


def built(kind):
    return of_configuration()[kind](kind=kind, **_tuples(CONFIGURED[kind])).build(BODY)


def _tuples(fields):
    return {name: _tuple(value) for name, value in fields.items()}


def _tuple(value):
    return tuple(map(_tuple, value)) if isinstance(value, list) else value


def test_each_class_of_the_core_has_a_row():
    classes = {
        name
        for name, value in vars(_core).items()
        if isinstance(value, type) and issubclass(value, _core.Potential) and value is not _core.Potential
    }
    assert classes - MADE_OF_OTHERS == {row.type.__name__ for row in _potentials.POTENTIALS.values()}
    assert classes <= set(el.__all__)
    assert _potentials.names().split(", ") == [row.type.__name__ for row in _potentials.POTENTIALS.values()]


def test_each_kind_has_a_model_in_configurations_and_in_scenarios():
    kinds = list(_potentials.POTENTIALS)
    assert list(of_configuration()) == kinds
    assert list(of_scenarios()) == kinds
    assert list(CONFIGURED) == kinds, "and an example in this test"


@pytest.mark.parametrize("kind", _potentials.POTENTIALS)
def test_a_kind_is_the_same_wherever_it_is_written(kind):
    potential = built(kind)
    row = _potentials.POTENTIALS[kind]
    assert type(potential) is row.type
    stored = json.loads(json.dumps(_potentials.potential_to_dict(potential)))
    for copy in (_potentials.potential_from_dict(stored), pickle.loads(pickle.dumps(potential))):
        assert repr(copy) == repr(potential)
    assert all(f"{name}=" in repr(potential) for name in row.parameters)
    assert el.GuaranteedRigidBodyFlow(BODY, potential, step=0.1).potential is potential


@pytest.mark.parametrize("kind", _potentials.POTENTIALS)
def test_the_formula_of_a_scenario_is_the_torque_of_the_core(kind):
    """The formula shares no code with the core. The names of a scenario's keys are a configuration's without units."""
    keys = {next((key[: -len(unit)] for unit in UNITS if key.endswith(unit)), key): key for key in CONFIGURED[kind]}
    values = _tuples(CONFIGURED[kind])
    scenario = of_scenarios()[kind](kind=kind, **{name: values[key] for name, key in keys.items()})
    rng, torque, core = np.random.default_rng(3), scenario.torque(BODY.inertia), built(kind)
    assert scenario.configured().model_dump() == of_configuration()[kind](kind=kind, **values).model_dump()
    for time in (0.0, 2.5):
        attitude = rotation(rng)
        np.testing.assert_allclose(torque(time, attitude), core.torque(attitude, time), atol=1e-13)


@pytest.mark.parametrize("kind", _potentials.POTENTIALS)
def test_backward_in_time_is_the_torque_at_minus_t(kind):
    rng, potential = np.random.default_rng(4), built(kind)
    turned = _potentials.backward(potential)
    for time in (0.5, 7.0):
        attitude = rotation(rng)
        np.testing.assert_allclose(turned.torque(attitude, time), potential.torque(attitude, -time), atol=1e-13)


def test_what_has_no_row_is_not_guessed():
    own = el.GradientPotential(lambda c, t: 0.0, lambda c, t: np.zeros((3, 3)))
    assert _potentials.kind_of(own) is None
    assert _potentials.backward(own) is None
    with pytest.raises(TypeError, match="of the type GradientPotential cannot be stored as JSON; use pickle"):
        _potentials.potential_to_dict(own)
    with pytest.raises(ValueError, match=r"'sprung', which is none of free, .*, quadratic, sum"):
        _potentials.potential_from_dict({"kind": "sprung"})
