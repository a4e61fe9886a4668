"""Power in the band where no stretch has any: nothing is estimated, and nothing is warned of."""

from types import SimpleNamespace

import numpy as np
import pytest

from skyproof.app.inspect.advice import estimate_power_over_quietest, remark_on_power


@pytest.mark.filterwarnings("error")
def test_without_any_power_nothing_is_estimated() -> None:
    front = SimpleNamespace(power_db=np.full(3, np.nan), stretch_s=np.arange(3.0))
    assert estimate_power_over_quietest(front) is None
    assert remark_on_power(front) == ()
