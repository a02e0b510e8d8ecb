"""The methods by which a scene can be run into a file, and the one call that does it.

A method is one way from a scene to a dataset of the common schema: the phase-space grid, the closed form, the particle
ensemble. Here it is a function that takes a `Job` (scene, file, what to do with an existing one, whom to tell how far it is),
hands frames to a `NetCDFRecorder` until the scene's end, and returns the lines that a person may want to read. Adding one is
one entry in `METHODS`. Every method looks after each of its steps whether it is to stop, keeps checkpoints (`Keeper`), and can be
resumed.
"""

from kinetic_solver.methods.interruption import Interruption
from kinetic_solver.methods.job import Job, Written
from kinetic_solver.methods.to_file import METHODS, Method, run_to_file

__all__ = ["METHODS", "Interruption", "Job", "Method", "Written", "run_to_file"]
