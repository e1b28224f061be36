"""What two passes rest on, and which of it has contradicted; theory, section 20.4."""

import numpy as np
from elliptude.results import DirectionLog, GuaranteedLog
from elliptude.smoothing import disputes


def rests_on(disputed, row, step):
    """The rows that a pass in steps of ``step`` rests on: back to its last dispute, but that of the row itself."""
    found = {row}
    at = row - step
    while not disputed[row] and 0 <= at < len(disputed) and not disputed[at]:
        found.add(at)
        at -= step
    return found


def proofs(disputed, step):
    """Sets of rows that contradict: of each beginning of a dispute, what the pass rested on, and that row."""
    found = []
    for row in range(len(disputed)):
        if begins(disputed, row, step):
            found.append(proof(disputed, row, step))
    return found


def begins(disputed, row, step):
    """Whether a pass comes into dispute at a row."""
    before = row - step
    return disputed[row] and not (0 <= before < len(disputed) and disputed[before])


def proof(disputed, row, step):
    """What has contradicted then: the row, and what the pass rested on before."""
    before = row - step
    return {row} | (rests_on(disputed, before, step) if 0 <= before < len(disputed) else set())


def test_what_has_contradicted_by_counting_rows():
    draws = np.random.default_rng(3)
    count = 0
    for _ in range(3000):
        n = draws.integers(1, 14)
        forward, backward = draws.random((2, n)) < draws.uniform(0.05, 0.6)
        found = {
            1: disputes.contested(forward[::-1], backward[::-1])[::-1],
            -1: disputes.contested(backward, forward),
        }
        passes = {1: forward, -1: backward}
        for step, own in passes.items():
            other = passes[-step]
            contradict = proofs(other, -step)
            for row in range(n):
                both = rests_on(own, row, step)
                if not other[row]:
                    both |= rests_on(other, row, -step)
                elif begins(other, row, -step):
                    both |= proof(other, row, -step)
                expected = not own[row] and any(those <= both for those in contradict)
                assert found[step][row] == expected
                count += expected
    assert count > 1000
    assert len(disputes.contested(np.zeros(0, dtype=bool), np.zeros(0, dtype=bool))) == 0


def test_rows_in_dispute():
    claims = np.array([0, 1, 2, 2], dtype=np.uint8)
    margins = np.array([-1.0, 1.0, 1.0, -1.0])
    nan = np.full((4, 6, 6), np.nan)
    flags = np.zeros(4, dtype=bool)
    sets = GuaranteedLog(margins, nan[:, :3, :3], nan[:, 0, :3], nan, claims, flags, flags, flags[:, None], margins)
    np.testing.assert_array_equal(disputes.of_sets(sets), [False, True, False, True])
    caps = DirectionLog(nan[:, 0, :3], nan[:, 0, 0], claims, np.array([True, False, False, True]))
    np.testing.assert_array_equal(disputes.of_caps(caps), [False, True, False, True])
