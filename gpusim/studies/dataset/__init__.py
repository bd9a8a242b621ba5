"""Data sets: pictures of a study's samples with exact labels, for who trains or tests.

In the order in which data passes:

- `sample_results`: What the store has of a sample.
- `splits`: Which structure comes into which split, and where pictures are cut.
- `label_files`: Flow as .flo, KITTI's PNG and TIFF; other layers as TIFF.
- `point_labels`: Poses and keypoints as COCO and BOP have them.
- `card`: What the data set says of itself.
- `dataset_folder`: Files that are written once, and a log that says what they hold.
- `writing`: The data set, written.
"""

from gpusim.public_names import public_names as _public_names
from gpusim.studies.dataset.writing import write_dataset as write_dataset

__all__, __getattr__, __dir__ = _public_names(__name__)
