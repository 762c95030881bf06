"""The tables and keys of scenarios and campaigns. No other folder imports pydantic."""

from pydantic import ValidationError as ValidationError

from flightbed.settings.base import known_keys as known_keys
from flightbed.settings.campaign import AxisSettings as AxisSettings
from flightbed.settings.campaign import CampaignSettings as CampaignSettings
from flightbed.settings.campaign import Criterion as Criterion
from flightbed.settings.load_factor import Autothrottle as Autothrottle
from flightbed.settings.load_factor import Identification as Identification
from flightbed.settings.scenario import LOAD_FACTOR_LAWS as LOAD_FACTOR_LAWS
from flightbed.settings.scenario import Adaptation as Adaptation
from flightbed.settings.scenario import AircraftSettings as AircraftSettings
from flightbed.settings.scenario import Atmosphere as Atmosphere
from flightbed.settings.scenario import Command as Command
from flightbed.settings.scenario import Condition as Condition
from flightbed.settings.scenario import Control as Control
from flightbed.settings.scenario import EstimatorSettings as EstimatorSettings
from flightbed.settings.scenario import Failure as Failure
from flightbed.settings.scenario import GainSettings as GainSettings
from flightbed.settings.scenario import GustSettings as GustSettings
from flightbed.settings.scenario import Lateral as Lateral
from flightbed.settings.scenario import ModelError as ModelError
from flightbed.settings.scenario import Prior as Prior
from flightbed.settings.scenario import ProcessNoise as ProcessNoise
from flightbed.settings.scenario import Rates as Rates
from flightbed.settings.scenario import RollCommand as RollCommand
from flightbed.settings.scenario import Scenario as Scenario
from flightbed.settings.scenario import Sensors as Sensors
from flightbed.settings.scenario import SideslipCommand as SideslipCommand
