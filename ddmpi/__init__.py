"""ddmpi: contact of elastic bodies with Tresca or Coulomb friction by domain decomposition.

The method is that of Haslinger, Kučera, Sassi and Riton: each body lives on its own MPI ranks,
solves with its own stiffness, and exchanges only interface vectors with its neighbour.
"""

__version__ = "0.1.0"
