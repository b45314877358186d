# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# shellcheck shell=bash
#
# An installation as a user may have it: the packages from a checkout, message classes beside them. It is one of fkie_mas where
# that is mounted, else one of multimaster_fkie.
if [ -d /opt/mas ]; then
  export ROS_PACKAGE_PATH=/opt/mas${ROS_PACKAGE_PATH:+:$ROS_PACKAGE_PATH}
  PYTHONPATH=/opt/mas/fkie_mas_pylib:/opt/mas/fkie_mas_daemon/src:/opt/needs/python:/opt/made:/opt/interop${PYTHONPATH:+:$PYTHONPATH}
  export PYTHONPATH=/opt/mas/fkie_mas_discovery/src:/opt/mas/fkie_mas_sync/src:$PYTHONPATH
else
  export ROS_PACKAGE_PATH=/opt/fkie${ROS_PACKAGE_PATH:+:$ROS_PACKAGE_PATH}
  export PYTHONPATH=/opt/fkie/fkie_master_discovery/src:/opt/fkie/fkie_master_sync/src:/opt/messages:/opt/interop${PYTHONPATH:+:$PYTHONPATH}
fi
