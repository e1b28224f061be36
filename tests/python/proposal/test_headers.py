"""Which headers state sensor, axis and unit."""

import pytest
from elliptude.proposal.mapping import of_headers

PHYPHOX = ["Time (s)"] + [
    f"{sensor} {axis} ({unit})"
    for sensor, unit in (
        ("Gyroscope", "rad/s"),
        ("Acceleration", "m/s^2"),
        ("Linear Acceleration", "m/s^2"),
        ("Magnetic field", "µT"),
    )
    for axis in "xyz"
]


def test_phyphox():
    tables = of_headers(PHYPHOX)
    assert (tables["time_column"], tables["time_unit"]) == ("Time (s)", "s")
    assert tables["flow"]["columns"] == PHYPHOX[1:4]
    # Without gravity it is no specific force.
    assert [(one["kind"], one["columns"]) for one in tables["directions"]] == [
        ("accelerometer", PHYPHOX[4:7]),
        ("magnetometer", PHYPHOX[10:13]),
    ]
    assert [one["unit"] for one in tables["directions"]] == ["m/s^2", "uT"]


def test_a_row_of_units():
    names = ["t", "gx", "gy", "gz", "ax", "ay", "az"]
    tables = of_headers(names, ["ms", *["dps"] * 3, *["mg"] * 3])
    assert (tables["time_column"], tables["time_unit"]) == ("t", "ms")
    assert (tables["flow"]["columns"], tables["flow"]["unit"]) == (["gx", "gy", "gz"], "deg/s")
    assert tables["directions"][0]["unit"] == "mg"


@pytest.mark.parametrize(
    "columns",
    [
        ["t", "gx", "gy", "gz"],
        ["Time (s)", "gx (g)", "gy (g)", "gz (g)"],
        ["Time (s)", "Gyro x (rad/s)", "Gyro y (deg/s)", "Gyro z (rad/s)"],
        ["Time (min)", "Gyro x (rad/s)", "Gyro y (rad/s)", "Gyro z (rad/s)"],
        ["Time (s)", *(f"{name} {axis} (rad/s)" for name in ("Gyro", "Gyro2") for axis in "xyz")],
    ],
)
def test_what_a_header_leaves_open_is_not_guessed(columns):
    assert of_headers(columns) is None
