"""Build of the package; ROS finds what is under share/locplan_ros."""

from glob import glob

from setuptools import setup

NAME = "locplan_ros"
SHARE = f"share/{NAME}"

setup(
    name=NAME,
    version="0.2.0",
    description="Serve locplan's masks to Nav2, and warn where a pose match is degenerate",
    license="Apache-2.0",
    maintainer="locplan developers",
    maintainer_email="locplan@example.org",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/launch", glob("launch/*.launch.py")),
        (f"{SHARE}/config", glob("config/*.yaml")),
        (f"{SHARE}/rviz", glob("rviz/*.rviz")),
    ],
    install_requires=["setuptools", "numpy"],
    zip_safe=True,
    entry_points={"console_scripts": [f"watch = {NAME}.watch_node:main"]},
)
