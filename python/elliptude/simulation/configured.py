"""The configuration that fits simulated measurements."""

import math

from elliptude.io import tables
from elliptude.simulation import scenarios
from elliptude.simulation.scenarios import Scenario
from elliptude.simulation.simulated import Simulation


def configuration_tables(scenario: Scenario, simulated: Simulation) -> dict[str, object]:
    """What `elliptude estimate` needs to know about these measurements, by the keys of `elliptude.configuration`."""
    degrees = math.degrees(simulated.direction_bound)
    first = simulated.measurements.references[0]
    return {
        "time_column": "time_s",
        "flow": {
            "kind": "rigid_body",
            "inertia_kg_m2": scenario.inertia,
            "step_s": scenario.step,
            "order": scenario.integrator_order,
            "potential": scenario.potential.configured().model_dump(exclude_none=True),
        },
        "directions": [
            {"name": sensor, "columns": tables.measured(sensor), "reference": reference.tolist(), "bound_deg": degrees}
            for sensor, reference in zip(simulated.measurements.sensors, first, strict=True)
        ],
        "rate": {"columns": tables.MEASURED_RATE, "bound_deg_per_s": math.degrees(simulated.rate_bound)},
        "start": _start(scenario.estimate0),
        "truth": {"attitude_columns": tables.QUATERNION, "vector_columns": tables.RATE},
    }


def _start(estimate0: scenarios.Estimate0) -> dict[str, object]:
    if estimate0.attitude == "first measurement":
        return {"kind": "first_measurement"}
    (quaternion,) = tables.quaternions_from_attitudes(estimate0.attitude.matrix()[None])
    return {
        "kind": "given",
        "attitude_qw_qx_qy_qz": quaternion.tolist(),
        "rate_rad_per_s": estimate0.rate,
        "P_diagonal": estimate0.P_diagonal,
    }
