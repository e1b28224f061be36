"""Real recordings as the proposals take them; see `datasets` for where they are."""

import numpy as np
from datasets import broad
from elliptude.proposal.proposals import Recording


def broad_recording(trial):
    """An excerpt of the BROAD dataset by the number of its trial."""
    with np.load(broad(trial)) as file:
        return Recording(*(file[name].astype(np.float64) for name in ("t", "gyr", "acc", "mag", "q_ref")))
