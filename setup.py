# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Distribution, find_packages, setup

package_name = 'icofabric_sim'
# package.xml is the one place where the version is written.
version = ElementTree.parse('package.xml').findtext('version')
# Compiled kernels, and the versions that they need; only in the tree that .ci/wheel.py makes.
compiled = Path('icofabric_sim/kernels/compiled')
pinned = (compiled / 'requirements.txt').read_text().split() if compiled.is_dir() else []


class CompiledDistribution(Distribution):
    """A distribution for one Python and one kind of machine if it has compiled kernels."""

    def has_ext_modules(self):
        """Return True if the wheel has compiled kernels."""
        return bool(pinned)


setup(
    distclass=CompiledDistribution,
    name=package_name,
    version=version,
    # So an editable install adds this folder to the search path. Without it setuptools installs a
    # finder instead, and any folder site-packages/icofabric_sim, also an empty one, hides that.
    package_dir={'': '.'},
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={f'{package_name}.kernels': ['compiled/**']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{package_name}/config', sorted(glob('config/*.*'))),
        (f'share/{package_name}/rviz', sorted(glob('rviz/*.rviz'))),
    ],
    # What the command line and Python need. Oldest versions: those of Ubuntu 24.04.
    install_requires=['numba>=0.58', 'numpy>=1.26', 'PyYAML', 'rosbags', 'scipy>=1.11', *pinned],
    extras_require={
        # Nodes, where no ROS is installed; ROS knows the same packages under other names.
        'ros': ['ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces==5.3.6'],
        # `icofabric render` and the pictures of statics and modes.
        'pictures': ['matplotlib'],
        # `icofabric film`: its wheel carries ffmpeg.
        'film': ['imageio-ffmpeg', 'matplotlib'],
        # The page of `viewer_node` and of `icofabric view`.
        'viewer': ['viser>=1.1,<1.2'],
        # `icofabric sweep` and `icofabric_sim.sweep` on several workers; Parquet tables.
        'sweep': ['distributed', 'pandas', 'pyarrow'],
        # One fabric on several processes: `icofabric run --ranks`, `ico.Ranks`. A cluster
        # has its own MPI library: there mpi4py alone.
        'mpi': ['mpi4py', 'mpich'],
        # The steps on an NVIDIA GPU: `solver.device: cuda`.
        'gpu': ['warp-lang'],
        'test': ['hypothesis', 'pytest', 'pytest-timeout', 'pytest-xdist'],
        # The site that `make docs` builds.
        'docs': ['furo', 'myst-parser', 'sphinx'],
        # The environment in examples/.
        'examples': ['gymnasium'],
    },
    python_requires='>=3.11',
    zip_safe=False,
    author='The icofabric_sim authors',
    maintainer='The icofabric_sim authors',
    maintainer_email='maintainers@icofabric-sim.example.org',
    description='Simulates icosahedral fabric and its answer to loads from ROS 2 messages.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'fabric_node = icofabric_sim.ros.fabric_node:main',
            'replay_node = icofabric_sim.ros.replay_node:main',
            'viewer_node = icofabric_sim.ros.viewer_node:main',
            'icofabric = icofabric_sim.commands.main:main',
        ],
    },
)
