"""What the robots of a type have in common, and how one robot more stands to it."""

from calib.population.hierarchy import Population, population
from calib.population.membership import Departure, adapted, departure, loosened
from calib.population.prior import Key, Prior

__all__ = [
    "Departure",
    "Key",
    "Population",
    "Prior",
    "adapted",
    "departure",
    "loosened",
    "population",
]
