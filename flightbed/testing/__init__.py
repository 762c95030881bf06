"""Checks for users' own estimators. The project's own tests are in ``tests/``."""

from flightbed.testing.check import Checked as Checked
from flightbed.testing.check import ContractError as ContractError
from flightbed.testing.check import check_estimator as check_estimator
