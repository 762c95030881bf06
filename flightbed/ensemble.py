"""Many flights of one plan: ``flightbed.analysis.seeds`` under its public name."""

from flightbed.analysis.seeds import Flown as Flown
from flightbed.analysis.seeds import Job as Job
from flightbed.analysis.seeds import fly_jobs as fly_jobs
from flightbed.analysis.seeds import histories as histories
from flightbed.analysis.seeds import processes as processes
