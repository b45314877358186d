# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# shellcheck shell=bash
#
# An installation of multimaster_fkie as a user may have it: the packages from a checkout, message classes beside them.
export ROS_PACKAGE_PATH=/opt/fkie${ROS_PACKAGE_PATH:+:$ROS_PACKAGE_PATH}
export PYTHONPATH=/opt/fkie/fkie_master_discovery/src:/opt/fkie/fkie_master_sync/src:/opt/messages:/opt/interop${PYTHONPATH:+:$PYTHONPATH}
