# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""master_discovery and master_sync: several ROS 1 masters as one system, in the wire format of multimaster_fkie."""
