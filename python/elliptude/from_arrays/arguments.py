"""What `elliptude.ahrs` calls sensors, units and statements: its arguments."""

import numpy as np

from elliptude.configuration.findings.finding import Axes, Key, Name, Remedy, TurnedRound, Words

OF_KINDS = {"gyro": "gyr", "accelerometer": "acc", "magnetometer": "mag"}
"""The argument for each kind of sensor."""
_TIMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}


class ArgumentWords(Words):
    """Sensors and units by the names of arguments, and a rule's keys as its file has them."""

    if_right = "If it is right as it is: implausible='ignore'"

    def sensor(self, name: str) -> str:
        """The argument that has what a sensor, or one of a rule, measured; directions are named after theirs."""
        return "gyr" if name == "the gyro" else OF_KINDS.get(name, name)

    def name(self, name: Name) -> str:
        """The same within a sentence."""
        return self.sensor(name.sensor)

    def key(self, key: Key) -> str:
        """An argument; a key of the file ``statements``; or what is made of an argument."""
        match key.of, key.name:
            case ("rule", name):
                return name
            case ("magnetometer", "reference_ut"):
                return "the reference that is made of it"
        return f"{OF_KINDS[key.of]}_{key.name}"

    def remedy(self, remedy: Remedy) -> str:
        """What to give; of times a question, as they have no unit."""
        if remedy.key.of == "time":
            return f"time is in s: are they {_TIMES[str(remedy.meant)]}?"
        return super().remedy(remedy)

    def to_state(self, remedy: Remedy) -> str:
        """What to give."""
        if remedy.key.of == "rule":
            return super().to_state(remedy)
        if remedy.key.name == "reference_ut":
            return "is mag_unit right?"
        if remedy.meant == "normalized":
            return "mag_unit='uT', and multiply mag by the field of the place in µT"
        return f"{self.key(remedy.key)}='{remedy.meant}'"

    def axes(self, axes: Axes) -> str:
        """An array's columns in another order, with other signs."""
        matrix = np.array(axes.matrix)
        order = np.argmax(np.abs(matrix), axis=1)
        signs = np.sign(matrix[np.arange(3), order])
        name = OF_KINDS[axes.of]
        ordered = name if (order == np.arange(3)).all() else f"{name}[:, {order.tolist()}]"
        if (signs == signs[0]).all():
            return ordered if signs[0] > 0.0 else f"-{ordered}"
        return f"{ordered} * {signs.astype(int).tolist()}"

    def turned_round(self, turned: TurnedRound) -> str:
        """The array's opposite."""
        return "-acc"


ARGUMENTS = ArgumentWords()
