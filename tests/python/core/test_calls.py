"""What a wrong call of the bindings says, and one line for each object of theirs."""

import inspect
import subprocess
import sys

import elliptude as el
import numpy as np
import pytest
from elliptude import _core

GYRO = el.GuaranteedGyroFlow(noise=0.1)
BODY = el.RigidBody(np.diag([1.0, 2.0, 2.5]))


def follower():
    return el.GuaranteedFilter(GYRO, vector_bound=0.1)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: el.exp(), "exp() needs the argument rotation_vector"),
        (lambda: el.exp(1, 2), "exp() takes at most 1 argument without a name, not 2"),
        (lambda: el.Ellipsoid(), "Ellipsoid() needs the arguments center and shape"),
        (lambda: el.FreeBody(3), "FreeBody() takes no argument, not 1"),
        (lambda: el.GuaranteedGyroFlow(nois=1), "GuaranteedGyroFlow() has no argument nois; did you mean noise?"),
        (lambda: el.DirectionFilter(x=1), "DirectionFilter() has no argument x; it has policy and regain_after"),
        (lambda: el.Integrator(BODY), "Integrator() needs the argument step"),
        (lambda: follower().predict(), "GuaranteedFilter.predict() needs the argument time"),
        (
            lambda: follower().predict(1.0, 2.0),
            "GuaranteedFilter.predict() takes at most 1 argument without a name, not 2; control_torque, "
            "wheel_momentum, gyro and increment must be named",
        ),
        (lambda: follower().predict(1.0, gyr=0), "GuaranteedFilter.predict() has no argument gyr; did you mean gyro?"),
        (
            lambda: follower().predict(1.0, time=2.0),
            "GuaranteedFilter.predict(): time is given twice, by its place and by its name",
        ),
        (lambda: _core.GuaranteedFilter.predict(3, 1.0), "self must be a GuaranteedFilter, not int"),
        (lambda: el.StateEllipsoid(np.eye(3), np.zeros(3), np.eye(6), chart=3), "chart must be a str, not int"),
        (lambda: el.Integrator(3, step=0.1), "Integrator(): body must be a RigidBody, not int"),
        (lambda: el.Integrator(BODY, step=0.1, order=1.5), "Integrator(): order must be an integer, not float"),
        (lambda: el.Integrator(BODY, step=0.1, order=10**30), "order is too large an integer: 1000"),
        (lambda: el.minimal_sum([3, 4]), "minimal_sum(): ellipsoids must hold an Ellipsoid, not int"),
        (lambda: el.minimal_sum(3), "minimal_sum(): ellipsoids must be a sequence, not int"),
    ],
)
def test_a_wrong_call_names_the_argument(call, said):
    with pytest.raises(TypeError) as raised:
        call()
    message = str(raised.value)
    assert said in message
    assert "\n" not in message
    assert "incompatible" not in message
    assert "array(" not in message  # no value is written out


def functions():
    """Every function and method of the module that a user may call."""
    for name, thing in vars(_core).items():
        if inspect.isclass(thing):
            for member, attribute in vars(thing).items():
                if callable(attribute) and (member == "__init__" or not member.startswith("_")):
                    yield f"{name}.{member}", attribute
        elif callable(thing):
            yield name, thing


@pytest.mark.parametrize(("name", "function"), list(functions()), ids=lambda one: one if isinstance(one, str) else "")
def test_no_function_lists_signatures(name, function):
    """One place does it for all: neither too many arguments nor an unknown one brings pybind11's own words."""
    if name == "Potential.__init__":
        return  # cannot be made
    for arguments, named in (((object(),) * 40, {}), ((), {"no_such_argument": 1})):
        with pytest.raises(TypeError) as raised:
            function(*arguments, **named)
        assert "incompatible" not in str(raised.value)
        assert "\n" not in str(raised.value)
        assert name.rpartition(".")[2].strip("_") in str(raised.value) or name.partition(".")[0] in str(raised.value)


def test_errors_of_other_kinds_pass():
    """What is said of a value is said as before, and so are the errors of a user's own code."""
    with pytest.raises(TypeError, match="rotation_vector must hold real numbers, not <U1"):
        el.exp("a")
    with pytest.raises(ValueError, match="noise"):
        el.GuaranteedGyroFlow(noise=-1.0)
    assert (el.Ellipsoid([1.0, 2.0], np.eye(2)) == 3) is False
    with pytest.raises(TypeError, match="unsupported operand"):
        el.Ellipsoid([1.0, 2.0], np.eye(2)) + 3

    class Own:
        def energy(self, attitude, time):
            return 0.0

        def torque(self, attitude, time):
            return el.exp()

        def torque_jacobian(self, attitude, time):
            return np.zeros((3, 3))

    with pytest.raises(TypeError, match=r"^exp\(\) needs the argument rotation_vector$"):
        el.Integrator(BODY, Own(), step=0.1).step(np.eye(3), np.array([0.0, 0.0, 1.0]), 0.1)


def test_the_complaint_of_another_library_is_not_about_our_arguments():
    """A user's function may call one that pybind11 has made, and wrongly."""
    theirs = "foo(): incompatible function arguments. The following argument types are supported:\n    1. () -> None\n"

    class Own:
        def energy(self, attitude, time):
            return 0.0

        def torque(self, attitude, time):
            raise TypeError(theirs)

        def torque_jacobian(self, attitude, time):
            return np.zeros((3, 3))

    with pytest.raises(TypeError) as raised:
        el.Integrator(BODY, Own(), step=0.1).step(np.eye(3), np.array([0.0, 0.0, 1.0]), 0.1)
    assert str(raised.value) == theirs


def test_an_interrupt_while_a_wrong_call_is_worded_is_not_lost(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("elliptude.errors._said_of_call", interrupted)
    with pytest.raises(KeyboardInterrupt):
        el.exp()


def test_a_name_that_is_no_text_does_not_end_the_process():
    """pybind11 throws at it where nothing catches."""
    program = (
        "import elliptude as el\ntry:\n    el.exp(**{chr(0xD800): 1})\nexcept (TypeError, UnicodeError):\n    pass\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)


@pytest.mark.parametrize(
    ("thing", "said"),
    [
        (
            el.GuaranteedGyroFlow(0.1, np.diag([1.0, 2.0, 3.0]), longest_interval=0.02),
            "<GuaranteedGyroFlow: noise 0.1, drift an ellipsoid, scale 0, angular_acceleration 0, "
            "interval_rate 'mean_of_ends', longest_interval 0.02>",
        ),
        (el.GyroFlow(0.1), "<GyroFlow: noise 0.1, drift 0>"),
        (
            el.RigidBodyFlow(BODY, step=0.1),
            "<RigidBodyFlow: body RigidBody, potential FreeBody, step 0.1, order 2, unknown_torque 0, "
            "most_steps 1000000>",
        ),
        (
            el.GuaranteedRigidBodyFlow(BODY, step=0.1, unknown_torque=0.01),
            "<GuaranteedRigidBodyFlow: body RigidBody, potential FreeBody, step 0.1, unknown_torque 0.01, "
            "inertia_error 0, most_steps 1000000>",
        ),
        (el.DirectionFilter(), "<DirectionFilter: policy 'raise', regain_after 10, claim 'none', angle 3.14159>"),
    ],
)
def test_objects_in_one_line(thing, said):
    assert repr(thing) == said


def test_no_public_class_shows_an_address():
    for name in el.__all__:
        kind = getattr(el, name)
        if inspect.isclass(kind) and kind.__module__.startswith("elliptude._core"):
            assert kind.__repr__ is not object.__repr__, name


CLASSES = [
    name
    for name, thing in vars(_core).items()
    if inspect.isclass(thing) and not name.startswith("_") and name != "Potential"
]


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_has_the_signature_of_its_call(name):
    """Jupyter and editors show it; the docstring's first line has it, too."""
    assert str(inspect.signature(getattr(el, name))) == getattr(_core, name).__text_signature__


def test_names_of_sensors_that_are_none():
    with pytest.raises(TypeError, match="sensors must be a sequence of names, not int"):
        follower().update([[0, 0, 1]], [[0, 0, 1]], [1.0], sensors=3)
