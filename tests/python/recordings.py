"""Real recordings that are not part of the project: in a folder `shared/datasets` beside one of the folders above."""

from pathlib import Path

import numpy as np
from elliptude.proposals import Recording

_FOLDERS = [folder / "shared" / "datasets" for folder in Path(__file__).resolve().parents]
DATASETS = next((folder for folder in _FOLDERS if folder.is_dir()), Path("shared/datasets"))
BROAD = DATASETS / "broad"


def broad_recording(trial):
    """An excerpt of the BROAD dataset by the number of its trial."""
    (path,) = BROAD.glob(f"{trial}_*.npz")
    with np.load(path) as file:
        return Recording(*(file[name].astype(np.float64) for name in ("t", "gyr", "acc", "mag", "q_ref")))
