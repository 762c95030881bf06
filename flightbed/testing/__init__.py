"""Checks for users' own estimators, laws, failures and commands. The project's own tests are in ``tests/``."""

from flightbed.testing.check import Checked as Checked
from flightbed.testing.check import ContractError as ContractError
from flightbed.testing.check import check_estimator as check_estimator
from flightbed.testing.parts import CheckedLaw as CheckedLaw
from flightbed.testing.parts import check_command as check_command
from flightbed.testing.parts import check_failure as check_failure
from flightbed.testing.parts import check_law as check_law
