"""A gyro's log and its configuration, for the tests of smoothing."""

import numpy as np
from elliptude.configuration import Configuration
from elliptude.logs import Log
from inputs import turning_body
from reference import so3

REFERENCES = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, -0.8]])


def gyro_log(seed=0, count=300, step=0.05, *, bound=0.05, noise=0.002, bias=0.01):
    """Directions with errors at their bounds, now and then; a constant bias."""
    draws = np.random.default_rng(seed)
    times = step * np.arange(count)
    true, attitudes = turning_body(draws, times)

    def unit(*shape):
        vectors = draws.standard_normal((*shape, 3))
        return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)

    directions = np.full((count, 2, 3), np.nan)
    for k in range(0, count, 20):
        for i in range(2):
            directions[k, i] = so3.exp(bound * unit()) @ attitudes[k].T @ REFERENCES[i]
    biases = np.tile(bias * unit(), (count, 1))
    return Log(
        times=times,
        directions=directions,
        references=np.tile(REFERENCES, (count, 1, 1)),
        rates=true + biases + noise * unit(count),
        true_attitudes=attitudes,
        true_vectors=biases,
    )


def gyro_configuration(policy="raise", **changes):
    tables = {
        "reference_frame": "ENU",
        "flow": {
            "kind": "gyro",
            "columns": ["x", "y", "z"],
            "interval_rate": "first_sample",
            "noise_deg_per_s": np.rad2deg(0.002),
            "bias_deg_per_s": np.rad2deg(0.01),
            "estimate_bias": True,
        },
        "directions": [
            {"name": name, "columns": list(columns), "reference": reference.tolist(), "bound_deg": np.rad2deg(0.05)}
            for name, columns, reference in zip(("one", "two"), ("abc", "def"), REFERENCES, strict=True)
        ],
        "estimator": {"mode": "guaranteed", "policy": policy},
    }
    return Configuration.model_validate(tables | changes)
