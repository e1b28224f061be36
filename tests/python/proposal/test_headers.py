"""Which headers state sensor, axis and unit."""

import pytest
from elliptude import units
from elliptude.cli.columns import in_words
from elliptude.proposal.mapping import of_headers, why_not_stated

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


def test_a_unit_is_said_once():
    """In a header and as what it is read; another one than the header's is said beside it."""
    tables = of_headers(PHYPHOX)
    assert in_words(tables) == [
        "time: Time (s)",
        "gyro: Gyroscope x, Gyroscope y, Gyroscope z (rad/s)",
        "accelerometer: Acceleration x, Acceleration y, Acceleration z (m/s^2)",
        "magnetometer: Magnetic field x, Magnetic field y, Magnetic field z (uT)",
    ]
    tables["flow"]["unit"] = "deg/s"
    assert in_words(tables)[1].endswith("Gyroscope z (rad/s) (deg/s)")
    # Where a configuration leaves the unit out, it is that which this means.
    plain = {"flow": {"kind": "gyro", "columns": ["g[0]", "g[1]", "g[2]"]}}
    assert in_words(plain)[1] == "gyro: g[0], g[1], g[2] (rad/s)"


def test_euroc():
    rates = [f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"]
    forces = [f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"]
    tables = of_headers(["timestamp [ns]", *rates, *forces])
    assert (tables["time_column"], tables["time_unit"]) == ("timestamp [ns]", "ns")
    assert (tables["flow"]["columns"], tables["flow"]["unit"]) == (rates, "rad/s")
    (up,) = tables["directions"]
    assert (up["kind"], up["columns"], up["unit"]) == ("accelerometer", forces, "m/s^2")


def test_a_row_of_units():
    names = ["t", "gx", "gy", "gz", "ax", "ay", "az"]
    tables = of_headers(names, ["ms", *["dps"] * 3, *["mg"] * 3])
    assert (tables["time_column"], tables["time_unit"]) == ("t", "ms")
    assert (tables["flow"]["columns"], tables["flow"]["unit"]) == (["gx", "gy", "gz"], "deg/s")
    assert tables["directions"][0]["unit"] == "mg"


@pytest.mark.parametrize(
    ("spelled", "unit"),
    [
        ("T", "T"), ("mT", "mT"), ("µT", "uT"), ("uT", "uT"), ("nT", "nT"),
        ("G", "G"), ("Gauss", "G"), ("gauss", "G"), ("mG", "mG"), ("mGauss", "mG"),
    ],
)  # fmt: skip
def test_units_of_a_field(spelled, unit):
    gyro = ["Time (s)", *(f"Gyro {axis} (deg/s)" for axis in "xyz")]
    tables = of_headers([*gyro, *(f"Mag {axis} ({spelled})" for axis in "xyz")])
    assert tables["directions"][0]["unit"] == unit
    tables = of_headers(["t", *"abcdef"], ["s", *["dps"] * 3, *[spelled] * 3])
    assert tables is None  # a unit alone says no sensor
    tables = of_headers(["t", "gx", "gy", "gz", "mx", "my", "mz"], ["s", *["dps"] * 3, *[spelled] * 3])
    assert tables["directions"][0]["unit"] == unit


def test_every_unit_has_its_size_and_is_no_other_ones_spelling():
    sizes = {**units.TICKS_PER_SECOND, **units.ANGULAR_VELOCITY, **units.ACCELERATION, **units.FIELD}
    assert set(units.SPELLINGS.values()) <= set(sizes)
    assert not set(units.SPELLINGS) & set(sizes)
    assert units.FIELD["mT"] == pytest.approx(1000.0 * units.FIELD["uT"]) == pytest.approx(10.0 * units.FIELD["G"])


def test_times_of_day_need_no_header():
    sensors = [f"Gyro {axis} (deg/s)" for axis in "xyz"]
    stamped = {"timestamp": "ns"}
    tables = of_headers(["timestamp", *sensors], of_day=stamped)
    assert (tables["time_column"], tables["time_unit"]) == ("timestamp", "ns")
    tables = of_headers(["timestamp", "gx", "gy", "gz"], ["", *["dps"] * 3], stamped)
    assert (tables["time_column"], tables["time_unit"]) == ("timestamp", "ns")
    # A header that states the unit of a time counts before one that is only known by its cells.
    tables = of_headers(["timestamp", "Time (ms)", *sensors], of_day=stamped)
    assert (tables["time_column"], tables["time_unit"]) == ("Time (ms)", "ms")
    two = {"sent": "ns", "received": "ns"}
    assert of_headers(["sent", "received", *sensors], of_day=two) is None
    assert why_not_stated(["sent", "received", *sensors], two) == "'sent' and 'received' are two columns of times"


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
