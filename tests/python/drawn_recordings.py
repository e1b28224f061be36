"""What tests of drawn recordings share: directions without reproach, and what makes a bound too small."""

from elliptude.validation.recordings.trials import RecordingArguments, try_recording

GUARANTEED = {"mode": "guaranteed", "policy": "drop_measurement", "best": "center"}
FIXED = {"name": "sun", "columns": ["px", "py", "pz"], "reference": [1.0, 0.2, 0.0], "bound_deg": 0.01}
STAR = FIXED | {"name": "star", "columns": ["qx", "qy", "qz"], "reference": [0.0, 0.1, 1.0]}


def faults(configuration, trials, seed=0):
    """How many of these recordings have a fault; stops at the first."""
    arguments = RecordingArguments(configuration, trials, seed)
    return any(try_recording(arguments, trial).verdict.is_fault for trial in range(trials))


def smaller(monkeypatch, owner, name, share=0.9):
    """Make what a function says this much smaller."""
    whole = getattr(owner, name)
    monkeypatch.setattr(owner, name, lambda *given, **more: share * whole(*given, **more))


def without(monkeypatch, owner, name):
    """Make a property zero."""
    monkeypatch.setattr(owner, name, property(lambda _: 0.0))


def require_noticed(monkeypatch, weaken, make):
    """Nothing is wrong with recordings of a configuration until one of the bounds is made too small."""
    configuration = make()
    assert not faults(configuration, 3)
    weaken(monkeypatch)
    assert faults(configuration, 60)
