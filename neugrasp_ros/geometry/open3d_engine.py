# SPDX-License-Identifier: Apache-2.0
"""The one place that imports Open3D.

Open3D's wheel is linked against libusb (for RealSense cameras, unused here), which a
slim machine lacks. Where the system has none, the copy of the ``libusb-package`` wheel
is loaded first; both have the same SONAME, so the linker is satisfied.
"""

import ctypes
import ctypes.util

if ctypes.util.find_library("usb-1.0") is None:
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)

import open3d as o3d  # noqa: E402

__all__ = ["o3d"]
