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


def disputes_of(met, anchors=None):
    margins = np.where(met, -1.0, 1.0)
    nan = np.full((len(met), 6, 6), np.nan)
    flags = np.zeros(len(met), dtype=bool)
    claims = met.astype(np.uint8)
    sets = GuaranteedLog(margins, nan[:, :3, :3], nan[:, 0, :3], nan, claims, flags, flags, flags[:, None], margins)
    return disputes.of_sets(sets, anchors)


def test_what_has_contradicted_by_counting_rows():
    draws = np.random.default_rng(3)
    count = 0
    for _ in range(3000):
        n = draws.integers(1, 14)
        forward, backward = draws.random((2, n)) < draws.uniform(0.05, 0.6)
        of_forward, of_backward = disputes_of(forward), disputes_of(backward[::-1]).turned_round()
        found = {
            1: disputes.contested(of_forward.turned_round(), of_backward.turned_round())[::-1],
            -1: disputes.contested(of_backward, of_forward),
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
    none = disputes_of(np.zeros(0, dtype=bool))
    assert len(disputes.contested(none, none)) == 0


def test_a_dispute_between_anchors_ends_where_it_began():
    met = np.zeros(9, dtype=bool)
    met[[2, 4, 7]] = True  # between two anchors; an anchor, which the next four rows have it from; one of these
    of_anchored = disputes_of(met, np.array([-1, 0, 0, 0, 0, 4, 4, 4, 4]))
    np.testing.assert_array_equal(np.flatnonzero(of_anchored.inherited), [5, 6, 7, 8])
    np.testing.assert_array_equal(np.flatnonzero(of_anchored.carried), [4])
    met[4] = False
    of_anchored = disputes_of(met, np.array([-1, 0, 0, 0, 0, 4, 4, 4, 4]))
    assert not of_anchored.carried.any()
    # A pass backward that has met a contradiction at one row rests at the rows before on what it rested on after it.
    own = disputes_of(met[::-1], np.array([-1, 0, 0, 0, 0, 4, 4, 4, 4])).turned_round()
    late = np.zeros(9, dtype=bool)
    late[8] = True
    found = disputes.contested(own, disputes_of(late))
    np.testing.assert_array_equal(found, ~met)
    # Each row that contradicts a set of an anchor is one more proof.
    found = disputes.contested(disputes_of(np.zeros(9, dtype=bool)), of_anchored)
    np.testing.assert_array_equal(np.flatnonzero(found), [0, 1, 2, 3, 4, 5, 6, 7])


def test_rows_in_dispute():
    claims = np.array([0, 1, 2, 2], dtype=np.uint8)
    margins = np.array([-1.0, 1.0, 1.0, -1.0])
    nan = np.full((4, 6, 6), np.nan)
    flags = np.zeros(4, dtype=bool)
    sets = GuaranteedLog(margins, nan[:, :3, :3], nan[:, 0, :3], nan, claims, flags, flags, flags[:, None], margins)
    np.testing.assert_array_equal(disputes.of_sets(sets, None).met, [False, True, False, True])
    caps = DirectionLog(nan[:, 0, :3], nan[:, 0, 0], claims, np.array([True, False, False, True]))
    np.testing.assert_array_equal(disputes.of_caps(caps, None).met, [False, True, False, True])
