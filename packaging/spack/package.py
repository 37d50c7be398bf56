"""For Spack: packages/py_ddmpi/package.py of a repository of one's own; see docs/start/installing.md. Not built yet."""

from spack_repo.builtin.build_systems.python import PythonPackage

from spack.package import *


class PyDdmpi(PythonPackage):
    """Contact of elastic bodies with Tresca or Coulomb friction by domain decomposition, on PETSc and MPI."""

    license("BSD-2-Clause")

    version("0.26.0")

    variant("figures", default=True, description="Draw pictures")
    variant("equilibrium", default=True, description="Ask whether contacts can hold loose bodies")

    depends_on("py-setuptools@77:", type="build")

    with default_args(type=("build", "run")):
        depends_on("python@3.11:")
        depends_on("py-numpy@1.24:")
        depends_on("py-scipy@1.10:")
        depends_on("py-mpi4py@3.1.4:")
        depends_on("py-petsc4py@3.18.5:")
        depends_on("py-h5py@3.7:")
        depends_on("gmsh@4.12:+opencascade")
        depends_on("py-meshio@5.3:")
        depends_on("py-msgspec@0.19:")
        depends_on("py-matplotlib@3.6:", when="+figures")
        depends_on("py-clarabel@0.11:", when="+equilibrium")

    depends_on("petsc+mumps")
