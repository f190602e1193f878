"""Connected parts, against SciPy's."""

import numpy as np
import pytest
from scipy import ndimage

from shoal.jit.kernels.connected import connected_parts


@pytest.mark.parametrize("corners", [False, True])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_same_labels_as_scipy(dimensions, corners):
    rng = np.random.default_rng(0)
    for share in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        for _ in range(10):
            free = rng.random(rng.integers(1, 12, size=dimensions)) < share
            wanted, number = ndimage.label(free, np.ones((3,) * dimensions) if corners else None)
            labels, found = connected_parts(free, corners=corners)
            assert found == number
            assert labels.dtype == np.int32
            np.testing.assert_array_equal(labels, wanted)
