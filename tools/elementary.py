"""elementary.py [--write]: the constants of the core's exp, log, sin, cos and atan2, and bounds of their errors.

Derives all numbers of cpp/include/elliptude/base/detail/elementary_constants.hpp with mpmath and prints that file, or
writes it with --write; then proves the bounds of theory, section 17.11, and prints them. The proof runs the functions
of base/elementary.hpp on thin intervals of their reduced argument, with a bound of the error of each operation
(Higham, Accuracy and Stability, section 3.3), and adds what the polynomials with their rounded coefficients lack.
"""

import argparse
import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import mpmath
from mpmath import mp, mpf

HEADER = Path(__file__).resolve().parents[1] / "cpp/include/elliptude/base/detail/elementary_constants.hpp"
mp.prec = 400


@dataclass(frozen=True)
class Format:
    """A binary format, and how the functions are set up for it."""

    name: str
    suffix: str  # of a literal
    digits: int  # bits of a significand
    greatest: int  # exponent of the greatest number
    ln2_digits: int  # of the first part of ln 2, which is multiplied by an exponent without rounding
    quadrants: int  # bits of a number of quarter turns that Cody and Waite's reduction takes
    terms: dict[str, int]

    @property
    def unit(self) -> Fraction:
        """The largest relative error of a rounding."""
        return Fraction(1, 2**self.digits)


DOUBLE = Format("double", "", 53, 1023, 42, 13, {"exp": 11, "log": 7, "sin": 6, "cos": 6, "atan": 10})
FLOAT = Format("float", "F", 24, 127, 16, 5, {"exp": 6, "log": 3, "sin": 3, "cos": 3, "atan": 4})
FORMATS = (DOUBLE, FLOAT)

REDUCED_EXPONENT = Fraction(34662, 100000)  # more than ln √2 and what rounding of k adds
REDUCED_ANGLE = Fraction(785406, 1000000)  # more than π/4, likewise
FIRST_BREAK, SECOND_BREAK = Fraction(5, 16), Fraction(23, 32)  # of the ratio in atan2
ROOT = mp.sqrt(2)


def rounded(x: mpf, digits: int) -> Fraction:
    """The nearest number with so many binary digits."""
    with mp.workprec(digits):
        nearest = +x
        man, exponent = nearest.man_exp
    return (-1 if nearest < 0 else 1) * Fraction(int(man)) * Fraction(2) ** int(exponent)


def grid(x: mpf, exponent: int) -> Fraction:
    """The nearest multiple of 2^exponent."""
    return Fraction(int(mp.nint(mp.ldexp(x, -exponent)))) * Fraction(2) ** exponent


def real(x: Fraction) -> mpf:
    return mpf(x.numerator) / x.denominator


# --- polynomials ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Series:
    """What a polynomial stands for: a power series on an interval, and a bound of its coefficients from one on."""

    coefficient: Callable[[int], mpf]
    low: Fraction
    high: Fraction
    ratio: mpf  # |coefficient(k + 1)| <= ratio |coefficient(k)|

    def __call__(self, z: mpf) -> mpf:
        return mp.fsum(self.coefficient(k) * z**k for k in range(260))


def series() -> dict[str, Series]:
    """By name: exp r = 1 + r + r² P(r); log (1 + f) from s (.. + z P(z)); sin, cos, atan from P(z), z a square."""
    square = REDUCED_ANGLE**2
    root = rounded(ROOT, 100)
    log_square = ((root - 1) / (root + 1)) ** 2 * Fraction(1000001, 1000000)
    sign = lambda k: -1 if k % 2 else 1  # noqa: E731
    return {
        "exp": Series(lambda k: 1 / mp.factorial(k + 2), -REDUCED_EXPONENT, REDUCED_EXPONENT, mpf(1) / 3),
        "log": Series(lambda k: mpf(2) / (2 * k + 3), Fraction(0), log_square, mpf(1)),
        "sin": Series(lambda k: -sign(k) / mp.factorial(2 * k + 3), Fraction(0), square, mpf(1) / 20),
        "cos": Series(lambda k: sign(k) / mp.factorial(2 * k + 4), Fraction(0), square, mpf(1) / 30),
        "atan": Series(lambda k: mpf(sign(k)) / (2 * k + 3), Fraction(0), FIRST_BREAK**2, mpf(1)),
    }


def fitted(of: Series, terms: int, digits: int) -> list[Fraction]:
    """Coefficients of the polynomial that meets the series at Chebyshev's points, rounded."""
    middle, half = real(of.low + of.high) / 2, real(of.high - of.low) / 2
    points = [middle + half * mp.cos(mp.pi * (2 * i + 1) / (2 * terms)) for i in range(terms)]
    matrix = mpmath.matrix([[z**k for k in range(terms)] for z in points])
    solved = mpmath.lu_solve(matrix, mpmath.matrix([of(z) for z in points]))
    return [rounded(solved[k], digits) for k in range(terms)]


class Lack:
    """How far a polynomial is from its series: Taylor's formula for their difference D about the middle of an interval.

    |D| <= Σ hⁱ |D⁽ⁱ⁾(middle)|/i! for i < 4, h⁴ Σ binomial(k, 4) |dₖ| mostᵏ⁻⁴, and what follows the last of 40 terms.
    """

    ORDER = 4
    TERMS = 40

    def __init__(self, of: Series, coefficients: list[Fraction]) -> None:
        most = max(abs(real(of.low)), abs(real(of.high)))
        self.tail = float(abs(of.coefficient(self.TERMS)) * most**self.TERMS / (1 - of.ratio * most))
        with mp.workprec(160):
            lacking = [
                (real(coefficients[k]) if k < len(coefficients) else mpf(0)) - of.coefficient(k)
                for k in range(self.TERMS)
            ]
            # D⁽ⁱ⁾/i!, its highest coefficient first.
            self.scaled = [
                [math.comb(k, i) * lacking[k] for k in range(self.TERMS - 1, i - 1, -1)] for i in range(self.ORDER)
            ]
            powers = (
                math.comb(k, self.ORDER) * abs(lacking[k]) * most ** (k - self.ORDER) for k in range(4, self.TERMS)
            )
            self.remainder = float(mp.fsum(powers))

    def within(self, low: float, high: float) -> float:
        half = (high - low) / 2 * (1 + 1e-9)
        with mp.workprec(160):
            middle = mpf(low + high) / 2
            bound = 0.0
            for i, highest_first in enumerate(self.scaled):
                value = mpf(0)
                for c in highest_first:
                    value = value * middle + c
                bound += float(abs(value)) * half**i
        return (bound + half**self.ORDER * self.remainder + self.tail) * (1 + 1e-9)


# --- numbers with bounds of their error -------------------------------------------------------------------------------


def ulp(x: float, digits: int) -> float:
    """The unit in the last place of the binade of x > 0."""
    return math.ldexp(1.0, math.frexp(x)[1] - digits)


@dataclass(frozen=True)
class Known:
    """A number of the calculation: where it is, and how far from the number that exact arithmetic would have."""

    low: float
    high: float
    error: float
    digits: int

    @property
    def most(self) -> float:
        return max(abs(self.low), abs(self.high))

    def made(self, low: float, high: float, error: float, *, exact: bool = False) -> "Known":
        slack = 1e-13 * max(abs(low), abs(high)) + error
        low, high = low - slack, high + slack
        most = max(abs(low), abs(high))
        rounding = 0.0 if exact or most == 0 else ulp(most, self.digits) / 2
        return Known(low - rounding, high + rounding, (error + rounding) * (1 + 1e-12), self.digits)

    def of(self, x: float | Fraction) -> "Known":
        return Known(float(x), float(x), 0.0, self.digits)

    def __neg__(self) -> "Known":
        return Known(-self.high, -self.low, self.error, self.digits)

    def __add__(self, b: "Known") -> "Known":
        return self.made(self.low + b.low, self.high + b.high, self.error + b.error)

    def __sub__(self, b: "Known") -> "Known":
        return self + (-b)

    def __mul__(self, b: "Known") -> "Known":
        return self.times(b)

    def times(self, b: "Known", *, exact: bool = False) -> "Known":
        ends = [x * y for x in (self.low, self.high) for y in (b.low, b.high)]
        if self is b:
            least = 0.0 if self.low <= 0 <= self.high else min(ends)
            ends = [least, max(ends)]
        error = self.most * b.error + b.most * self.error + self.error * b.error
        return self.made(min(ends), max(ends), error, exact=exact)

    def __truediv__(self, b: "Known") -> "Known":
        least = min(abs(b.low), abs(b.high))
        ends = [x / y for x in (self.low, self.high) for y in (b.low, b.high)]
        return self.made(min(ends), max(ends), (self.error + self.most / least * b.error) / (least - b.error))

    def wrong_by(self, error: float) -> "Known":
        return Known(self.low, self.high, self.error + error, self.digits)


def horner(x: Known, coefficients: list[Fraction]) -> Known:
    result = x.of(coefficients[-1])
    for c in reversed(coefficients[:-1]):
        result = result * x + x.of(c)
    return result


def units(last: Known, true_low: float) -> float:
    """The error in units of the result's last place, if `last` is what is rounded in the end, before that.

    Half a unit for that rounding, and the errors before it in units of the smallest result. A result that is rounded
    up to a power of two is not farther from the true one than what was rounded.
    """
    return 0.5 + last.error / ulp(true_low * (1 - 1e-12), last.digits)


def unrounded_sum(a: Known, b: Known) -> Known:
    return a.made(a.low + b.low, a.high + b.high, a.error + b.error, exact=True)


def cells(low: float, high: float, count: int) -> Iterator[tuple[float, float]]:
    for i in range(count):
        yield low + (high - low) * i / count, low + (high - low) * (i + 1) / count


def binade_cells(low: float, high: float, count: int) -> Iterator[tuple[float, float]]:
    """Intervals that begin anew at each power of two: as many as stated above 1/64, and few below."""
    for binade in range(math.frexp(low)[1], math.frexp(high)[1] + 1):
        begin, end = max(low, math.ldexp(0.5, binade)), min(high, math.ldexp(1.0, binade))
        if begin < end:
            yield from cells(begin, end, count if binade > -6 else 12)


# --- constants --------------------------------------------------------------------------------------------------------


def split_constants(form: Format) -> dict[str, Fraction]:
    """ln 2 and π/2 in parts whose products with integers are exact, and π/2 in two for Payne and Hanek's reduction."""
    ln2, quarter = mp.ln(2), mp.pi / 2
    ln2_high = grid(ln2, -form.ln2_digits)
    first = grid(quarter, form.quadrants - form.digits + 1)
    # So few bits that the difference after it is exact, too, where it cancels.
    second = grid(quarter - real(first), 2 * (form.quadrants - form.digits + 1))
    half_digits = form.digits // 2
    return {
        "per_ln2": rounded(1 / ln2, form.digits),
        "ln2_high": ln2_high,
        "ln2_low": rounded(ln2 - real(ln2_high), form.digits),
        "per_quarter": rounded(1 / quarter, form.digits),
        "quarter_first": first,
        "quarter_second": second,
        "quarter_third": rounded(quarter - real(first) - real(second), form.digits),
        "quarter": rounded(quarter, form.digits),
        "quarter_head": (head := rounded(quarter, half_digits)),
        "quarter_tail": rounded(quarter - real(head), form.digits),
        "root_half": rounded(mp.sqrt(mpf(1) / 2), form.digits),
    }


def atan_bases(form: Format) -> list[list[tuple[Fraction, Fraction]]]:
    """For (|y| > |x|, x < 0): what is added to the reduced angle, in two parts, for each of the three centers."""
    centers = [mpf(0), mp.atan(mpf(1) / 2), mp.pi / 4]
    rows = [centers, [mp.pi - c for c in centers]]
    rows += [[mp.pi / 2 - c for c in centers], [mp.pi / 2 + c for c in centers]]
    result = []
    for row in rows:
        pairs = []
        for angle in row:
            high = rounded(angle, form.digits) if angle else Fraction(0)
            low = rounded(angle - real(high), form.digits) if angle else Fraction(0)
            pairs.append((high, low))
        result.append(pairs)
    return result


WORDS = 40


def two_over_pi() -> list[int]:
    """64 zero bits and then those of 2/π, in words of 32."""
    with mp.workprec(32 * WORDS + 100):
        digits = int(mp.floor(mp.ldexp(2 / mp.pi, 32 * WORDS - 64)))
    return [(digits >> (32 * (WORDS - 1 - i))) & 0xFFFFFFFF for i in range(WORDS)]


def polynomials(form: Format) -> dict[str, list[Fraction]]:
    return {name: fitted(of, form.terms[name], form.digits) for name, of in series().items()}


# --- proofs -----------------------------------------------------------------------------------------------------------


def prove_exp(form: Format, poly: list[Fraction]) -> float:
    """1 + (high - (low - r² P(r))), r = high - low, whose own rounding counts only in P. The scale is exact."""
    lack, parts = Lack(series()["exp"], poly), split_constants(form)
    # k ln2_low: the constant's own rounding and the product's; |k| <= 2^11 (2^8).
    most_k = 1.0 * 2 ** (11 if form is DOUBLE else 8)
    low_size = most_k * float(abs(parts["ln2_low"]))
    low_error = 2 * low_size * float(form.unit)
    zero = Known(0.0, 0.0, 0.0, form.digits)
    worst = 0.0
    edge = float(REDUCED_EXPONENT)
    for a, b in cells(-edge, edge, 600):
        low = Known(-low_size, low_size, low_error, form.digits)
        r = zero.made(a, b, low_error)
        curved = (r * r) * horner(r, poly)
        curved = curved.wrong_by(max(a * a, b * b) * lack.within(a, b))
        # Intervals know nothing of high - low = r: the value of high - inner is that of r + r² P(r).
        inner = low - curved
        linear = zero.made(a + curved.low, b + curved.high, inner.error)
        last = unrounded_sum(zero.of(1.0), linear)
        worst = max(worst, units(last, math.exp(a)))
    return worst


def prove_log(form: Format, poly: list[Fraction]) -> float:
    """k ln2_high - ((h - (s (h + R) + k ln2_low)) - f), h = f²/2, s = f/(2 + f), R = z P(z), z = s²."""
    lack, parts = Lack(series()["log"], poly), split_constants(form)
    zero = Known(0.0, 0.0, 0.0, form.digits)
    ln2 = math.log(2)
    most_k = 1100 if form is DOUBLE else 150
    worst = 0.0
    edge = math.sqrt(2) * (1 + 1e-6)
    tiny = 2.0 ** -(form.digits + 1)
    positive = list(binade_cells(tiny, edge - 1, 100))
    negative = [(-b, -a) for a, b in binade_cells(tiny / 2, 1 - 1 / edge, 100)]
    for a, b in positive + negative:
        f = Known(a, b, 0.0, form.digits)
        s = f / (zero.of(2.0) + f)
        z = s * s
        rest = z * horner(z, poly)
        rest = rest.wrong_by(z.most * lack.within(z.low, z.high))
        h = zero.of(0.5).times(f * f, exact=True)
        product = s * (h + rest)
        for k in (0, 1, -1, 2, -2, 3, -3, most_k, -most_k):
            low = zero.of(k) * zero.of(parts["ln2_low"])
            low = low.wrong_by(abs(k) * float(parts["ln2_low"]) * float(form.unit))
            if k == 0:
                low, added = zero, product  # a sum with zero is exact
            else:
                added = product + low
            inner = (h - added) - f
            last = unrounded_sum(zero.of(k * float(parts["ln2_high"])), -inner)
            if k == 0:
                # The subtraction of f is the last rounding; that from zero is exact.
                last = unrounded_sum(-(h - added), f)
            least = min(abs(k * ln2 + math.log1p(a)), abs(k * ln2 + math.log1p(b)))
            worst = max(worst, units(last, least))
    # Beyond |k| = 3 the same errors are units of a larger result: nothing above grows with k but k ln2_low, as tried.
    return worst


def smallest_remainders(form: Format) -> tuple[float, float]:
    """The least |x - n π/2| > 0 of a number x in the format: for |n| < 2^quadrants, and for all n.

    For each exponent x = m 2^e, and |m 2^e/(π/2) - n| of m < M is least at a convergent of the continued fraction.
    """
    near, far = mpf(1), mpf(1)
    with mp.workprec(form.greatest + 400):
        for e in range(-form.digits, form.greatest - form.digits + 2):
            alpha = mp.ldexp(2 / mp.pi, e)
            p, q, p_last, q_last, x = int(mp.floor(alpha)), 1, 1, 0, alpha
            while True:
                if q < 2**form.digits:
                    distance = abs(q * alpha - p) * mp.pi / 2
                    if p > 0 or q > 0:
                        far = min(far, distance)
                        if q * alpha < 2 ** (form.quadrants + 1):
                            near = min(near, distance)
                else:
                    break
                x = 1 / (x - mp.floor(x))
                term = int(mp.floor(x))
                p, p_last, q, q_last = term * p + p_last, p, term * q + q_last, q
    return float(near), float(far)


def reduction_errors(form: Format) -> tuple[float, float]:
    """Relative errors of the reduced angle, high + low, by Cody and Waite and by Payne and Hanek. (theory, 17.11)"""
    parts, u, n = split_constants(form), float(form.unit), 2.0**form.quadrants
    near, far = smallest_remainders(form)
    given = sum((parts[name] for name in ("quarter_first", "quarter_second", "quarter_third")), Fraction(0))
    representation = n * float(abs(real(given) - mp.pi / 2))
    third = n * float(abs(parts["quarter_third"]))
    # The product with the third part, its difference with what the second left (u of the reduced angle), and `low`.
    absolute = representation + 2 * third * u
    cody_waite = absolute / (near - absolute) + 3 * u * u
    piece = 32 if form is DOUBLE else 16
    cut = 2.0 ** (2 - 4 * piece)  # of the fraction of a quarter turn: what four pieces leave, and its negation
    head = 2.0 ** (1 - form.digits // 2)
    # The sums of pieces are exact but for one, which has a rounding only where the first piece is not zero.
    payne_hanek = cut / (far * 2 / math.pi) + 2 * u * (u + 2.0**-piece) + 16 * head * u
    return cody_waite, payne_hanek


def prove_sin_cos(form: Format, sin: list[Fraction], cos: list[Fraction]) -> tuple[float, float]:
    """high + (low + high z P(z)), and w + (((1 - w) - z/2) + (z² Q(z) - high low)), w = 1 - z/2. (theory, 17.11)"""
    sin_lack, cos_lack = Lack(series()["sin"], sin), Lack(series()["cos"], cos)
    zero = Known(0.0, 0.0, 0.0, form.digits)
    relative = max(reduction_errors(form))
    worst_sin = worst_cos = 0.0
    least = 2.0 ** (-form.digits // 2 - 1)
    # A sine below `least` in magnitude is its argument, or the like with a low part.
    for a, b in binade_cells(least, float(REDUCED_ANGLE), 300):
        high = Known(a, b, 0.0, form.digits)
        low = Known(-ulp(b, form.digits) / 2, ulp(b, form.digits) / 2, relative * b, form.digits)
        z = high * high
        odd = (high * z) * horner(z, sin)
        odd = odd.wrong_by(b**3 * sin_lack.within(z.low, z.high))
        # sin(high + low) = sin high + low cos high to second order: low is taken for low cos high.
        left_out = low.most * (b * b / 2 + low.most)
        last = unrounded_sum(high, (low + odd).wrong_by(left_out))
        worst_sin = max(worst_sin, units(last, math.sin(a)))

        half = zero.of(0.5).times(z, exact=True)
        # w + ((1 - w) - z/2) is exact: of w's error only z's is left.
        even = (z * z) * horner(z, cos)
        even = even.wrong_by(b**4 * cos_lack.within(z.low, z.high))
        correction = Known(-ulp(1.0, form.digits), ulp(1.0, form.digits), 0.0, form.digits)
        small = correction + (even - high * low)
        left_out = low.most * (b**3 / 6 + low.most)
        last = Known(0.0, 0.0, small.error + half.error + left_out, form.digits)
        worst_cos = max(worst_cos, units(last, math.cos(b)))
    return worst_sin, worst_cos


def prove_atan2(form: Format, poly: list[Fraction]) -> float:
    """base_high - ((t z P(z) - base_low) - t), t = ± (n - c m)/(m + c n), c one of 0, ½, 1. (theory, 17.11)"""
    lack, u = Lack(series()["atan"], poly), float(form.unit)
    zero = Known(0.0, 0.0, 0.0, form.digits)
    bases = atan_bases(form)
    worst = 0.0
    slack = 1e-6 if form is FLOAT else 1e-15
    spans = [(2.0**-40, float(FIRST_BREAK), 0.0), (float(FIRST_BREAK), float(SECOND_BREAK), 0.5)]
    spans += [(float(SECOND_BREAK), 1.0, 1.0)]
    for center, (begin, end, c) in enumerate(spans):
        for a, b in binade_cells(begin * (1 - slack), min(1.0, end * (1 + slack)), 200):
            ends = [(a - c) / (1 + c * a), (b - c) / (1 + c * b)]
            # The numerator is exact, the denominator has one rounding if c is not zero.
            t = zero.made(min(ends), max(ends), 0.0 if c == 0 else u * max(map(abs, ends)) * (1 + 2 * u))
            z = t * t
            for sector, sign in enumerate((1, -1, -1, 1)):
                high, low = bases[sector][center]
                turned = t if sign > 0 else -t
                odd = (turned * z) * horner(z, poly)
                odd = odd.wrong_by(t.most * z.most * lack.within(z.low, z.high))
                second = float(abs(low)) * u + 2.0 ** (-3 * form.digits)
                inner = odd - zero.of(low).wrong_by(second) if low else odd
                before = inner - turned if high else unrounded_sum(inner, -turned)
                last = unrounded_sum(zero.of(high), -before)
                true = [abs(float(high) + sign * math.atan(x)) for x in ends]
                worst = max(worst, units(last, min(true)))
    # Below 2^-40 the product with P is nothing, and the quotient's rounding is all.
    return worst


def bounds(form: Format) -> dict[str, float]:
    """The errors of the functions in units of the last place of their results."""
    poly = polynomials(form)
    sine, cosine = prove_sin_cos(form, poly["sin"], poly["cos"])
    return {
        "exp": prove_exp(form, poly["exp"]),
        "log": prove_log(form, poly["log"]),
        "sin": sine,
        "cos": cosine,
        "atan2": prove_atan2(form, poly["atan"]),
    }


# --- the header -------------------------------------------------------------------------------------------------------


def literal(x: Fraction, form: Format) -> str:
    """A hexadecimal literal. Its value is a number of the format exactly."""
    value = float(x)
    assert Fraction(value) == x
    assert form is DOUBLE or struct.unpack("f", struct.pack("f", value))[0] == value
    mantissa, exponent = value.hex().split("p") if value else ("0x0", "+0")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}p{exponent}{form.suffix}"


def wrapped(begin: str, items: list[str], end: str, indent: str) -> list[str]:
    """Items on lines of at most 120 characters."""
    lines, line = [], begin
    for i, item in enumerate(items):
        text = item + ("," if i + 1 < len(items) else end)
        if len(line) + 1 + len(text) > 120:
            lines.append(line)
            line = indent + text
        else:
            line += text if line.endswith("{") else " " + text
    return [*lines, line]


def constants_of(form: Format) -> list[str]:
    poly, parts = polynomials(form), split_constants(form)
    lines = ["template <>", f"struct Constants<{form.name}> {{"]
    lines += [f"  static constexpr {form.name} {name} = {literal(x, form)};" for name, x in parts.items()]
    for name, coefficients in poly.items():
        begin = f"  static constexpr std::array<{form.name}, {len(coefficients)}> {name}{{"
        lines += wrapped(begin, [literal(c, form) for c in coefficients], "};", "      ")
    for part, index in (("base_high", 0), ("base_low", 1)):
        items = [literal(pair[index], form) for row in atan_bases(form) for pair in row]
        lines += wrapped(f"  static constexpr std::array<{form.name}, 12> {part}{{", items, "};", "      ")
    return [*lines, "};"]


def header() -> str:
    lines = [
        "#pragma once",
        "",
        "/// \\file",
        "/// The numbers of base/elementary.hpp. Written by tools/elementary.py, which derives them: do not edit.",
        "",
        "#include <array>",
        "#include <cstdint>",
        "",
        "namespace elliptude::elementary::detail {",
        "",
        "// clang-format off",
        "/// Parts of ln 2 and π/2, coefficients, and what atan2 adds to the reduced angle, by format.",
        "template <typename Real>",
        "struct Constants;",
        "",
    ]
    for form in FORMATS:
        lines += [*constants_of(form), ""]
    lines.append("/// 64 zero bits, and then those of 2/π.")
    begin = f"inline constexpr std::array<std::uint32_t, {WORDS}> two_over_pi{{"
    lines += wrapped(begin, [f"0x{word:08x}" for word in two_over_pi()], "};", "    ")
    return "\n".join([*lines, "// clang-format on", "", "}  // namespace elliptude::elementary::detail"]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the header")
    if parser.parse_args().write:
        HEADER.parent.mkdir(exist_ok=True)
        HEADER.write_text(header(), encoding="utf-8")
    else:
        print(header())
    for form in FORMATS:
        near, far = smallest_remainders(form)
        print(f"{form.name}: least remainder 2^{math.log2(near):.1f}, of all 2^{math.log2(far):.1f}")
        print("reduction errs by", " and ".join(f"2^{math.log2(e):.1f}" for e in reduction_errors(form)))
        for name, bound in bounds(form).items():
            print(f"{form.name} {name}: {bound:.3f} units in the last place")


if __name__ == "__main__":
    main()
