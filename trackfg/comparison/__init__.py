"""Every estimator on the same recordings, in one table; estimators of one's own among them (docs/own-estimator.md).

=================  ==================================================================================
module             content
=================  ==================================================================================
``run``            :func:`compare`, :func:`cases_of`
``estimators``     :class:`Estimator`, and all that are known
``table``          :class:`Comparison`: scores, curves, and what was compared
``case``           a case, and what one run of it gave
``railway_case``   a run against its truth, or against the smoother
``withheld_case``  a recording without a truth: measurements are withheld and predicted
``friction_case``  a car's drive: tyre friction
``withholding``    the parts of a recording that are withheld, and how well they are predicted
``differences``    where an estimator differs from the smoother, kilometre by kilometre
=================  ==================================================================================
"""

from typing import TYPE_CHECKING

from trackfg.lazy_imports import lazy_imports

if TYPE_CHECKING:
    from trackfg.comparison.estimators import Estimator
    from trackfg.comparison.run import cases_of, compare
    from trackfg.comparison.table import Comparison

__all__ = ["Comparison", "Estimator", "cases_of", "compare"]

__getattr__ = lazy_imports(
    __name__, {"Comparison": "table", "Estimator": "estimators", "cases_of": "run", "compare": "run"}
)


def __dir__() -> list[str]:
    return sorted(__all__)
