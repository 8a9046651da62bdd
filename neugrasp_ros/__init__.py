# SPDX-License-Identifier: Apache-2.0
"""Single-view neural grasping for mobile manipulators: the library and its ROS nodes.

Importing this package needs neither ROS nor torch; import the stage that you use.
"""

__version__ = "0.1.0"
