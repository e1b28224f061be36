"""What the TOML files of scenarios and configurations are made of: strict models, messages that name the key."""

import functools
import math
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import scipy
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Strict, ValidationError

from elliptude.io.files import FileError, system_fault
from elliptude.io.toml_faults import faults_in_words, syntax_in_words
from elliptude.typing import FloatArray

LARGEST = 1e40
"""No number of a file is larger: a planet's inertia is not, and products of several such numbers are finite."""
Number = Annotated[float, Strict(), Field(ge=-LARGEST, le=LARGEST)]
"""A number: no text, no true or false."""
Count = Annotated[int, Field(ge=1, le=1_000_000_000)]
Vector = tuple[Number, Number, Number]
Matrix = tuple[Vector, Vector, Vector]


class Model(BaseModel):
    """A table of a TOML file: every key is known, every number finite, nothing changes once it is read."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def exactly_one(model: Model, *keys: str) -> None:
    """Raise ValueError unless exactly one of the optional keys is given."""
    given = [key for key in keys if getattr(model, key) is not None]
    if len(given) != 1:
        raise ValueError(f"give exactly one of {', '.join(keys)}" + (f", not {' and '.join(given)}" if given else ""))


# Of a vector or a bound; below it a square is rounded to nothing.
_SHORTEST = 1e-130
_NO_SQUARE = "where the core holds its square"


def _has_direction(vector: tuple[float, ...], unit: str = "") -> tuple[float, ...]:
    if not any(vector):
        raise ValueError("must be a vector of positive length; that of [0, 0, 0] is 0, and it points nowhere")
    if math.hypot(*vector) < _SHORTEST:
        raise ValueError(f"must be at least {_SHORTEST:g}{unit} long, {_NO_SQUARE}")
    return vector


def _is_rotation(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    if not any(quaternion):
        raise ValueError("must be a quaternion of positive length; that of [0, 0, 0, 0] is 0, and it is no rotation")
    return quaternion


def _different(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        raise ValueError("must name different columns")
    return names


def one_word(name: str) -> str:
    """Names stand in a table's cell with a space between them."""
    if not name or any(character.isspace() or character in ',"' for character in name):
        raise ValueError("must be one word, without space, comma or quote")
    return name


def _squarable(bound: float) -> float:
    """A bound becomes a shape matrix by its square."""
    if bound != 0.0 and bound < _SHORTEST:
        raise ValueError(f"must be 0 or at least {_SHORTEST:g}, {_NO_SQUARE}")
    return bound


NonzeroVector = Annotated[Vector, AfterValidator(_has_direction)]
FieldVector = Annotated[Vector, AfterValidator(functools.partial(_has_direction, unit=" µT"))]
"""A magnetic field, µT."""
_OfAnyLength = Annotated[float, Strict(), Field(ge=-1e300, le=1e300)]
VectorOfAnyLength = tuple[_OfAnyLength, _OfAnyLength, _OfAnyLength]
"""Of which the direction counts alone."""
Quaternion = Annotated[tuple[_OfAnyLength, _OfAnyLength, _OfAnyLength, _OfAnyLength], AfterValidator(_is_rotation)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Size = Annotated[Number, Field(ge=0, le=1e9)]
"""A length, a duration, a rate or the like, in units of which nobody has more."""
PositiveSize = Annotated[Number, Field(gt=0, le=1e9)]
Gravity = Annotated[Number, Field(ge=1e-9, le=1e9)]
"""m/s²; less is that of a stone."""
SignedSize = Annotated[Number, Field(ge=-1e9, le=1e9)]
Bound = Annotated[Positive, AfterValidator(_squarable)]
Angle = Annotated[Bound, Field(lt=180)]
NotNegativeBound = Annotated[NotNegative, AfterValidator(_squarable)]
SizedBound = Annotated[Bound, Field(le=1e9)]
NotNegativeSizedBound = Annotated[NotNegativeBound, Field(le=1e9)]
Column = Annotated[str, Field(min_length=1)]
Columns = Annotated[tuple[Column, Column, Column], AfterValidator(_different)]
QuaternionColumns = Annotated[tuple[Column, Column, Column, Column], AfterValidator(_different)]
Diagonal6 = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
Vector6 = tuple[Number, Number, Number, Number, Number, Number]


class RotationVectorDeg(Model):
    """An attitude as the rotation vector from the reference frame, in degrees."""

    rotation_vector_deg: Vector

    def matrix(self) -> FloatArray:
        """The attitude C from body to reference axes, shape (3, 3)."""
        matrix: FloatArray = scipy.spatial.transform.Rotation.from_rotvec(
            self.rotation_vector_deg, degrees=True
        ).as_matrix()
        return matrix


def _identity_by_name(value: object) -> object:
    return {"rotation_vector_deg": [0.0, 0.0, 0.0]} if value == "identity" else value


Attitude = Annotated[RotationVectorDeg, BeforeValidator(_identity_by_name)]
"""``"identity"`` or ``{ rotation_vector_deg = [...] }``."""

SomeModel = TypeVar("SomeModel", bound=BaseModel)


def read_toml(path: str | os.PathLike[str], model: type[SomeModel], **defaults: object) -> SomeModel:
    """Read a TOML file into a model.

    Parameters
    ----------
    path : path-like
    model : type
        The pydantic model of the whole file.
    **defaults
        Keys that the file may leave out.

    Returns
    -------
    model
        An instance.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML (with line and column), or does not fit (with every key at fault).
    """
    return validate(path, defaults | load_toml(path), model)


def load_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises
    ------
    FileError
        If the file cannot be read, or is not TOML (with line and column).
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileError(f"{path}: {system_fault(error)}") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not UTF-8 text: save it as UTF-8") from error
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FileError(f"{path}: {syntax_in_words(str(error), text)}") from error
    except ValueError as error:  # more digits than Python takes
        raise FileError(f"{path}: not TOML: a number has thousands of digits") from error
    except RecursionError as error:
        raise FileError(f"{path}: not TOML: lists or tables within one another, hundreds deep") from error


def validate(path: str | os.PathLike[str], data: Mapping[str, Any], model: type[SomeModel]) -> SomeModel:
    """The model of some tables.

    Raises
    ------
    FileError
        If they do not fit: with the path that they are of, and every key at fault.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise FileError(f"{path}: {faults_in_words(error, data, model)}") from error


def unit(vector: Vector) -> Vector:
    """The vector at length 1, for a validator.

    Parameters
    ----------
    vector : tuple of 3 floats

    Returns
    -------
    tuple of 3 floats

    Raises
    ------
    ValueError
        If it has no length.
    """
    largest = max(map(abs, vector))
    if largest == 0.0:
        raise ValueError("a direction must have a length")
    # The squares of very large or small numbers overflow or vanish.
    x, y, z = (component / largest for component in vector)
    length = float(np.linalg.norm((x, y, z)))
    return (x / length, y / length, z / length)
