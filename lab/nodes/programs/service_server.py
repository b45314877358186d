# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A service that says on which computer it runs: an ordinary rospy node that knows nothing of the collection."""

import socket
import sys

import rospy
from std_srvs.srv import Trigger, TriggerResponse

rospy.init_node(sys.argv[1])
rospy.Service("/" + sys.argv[1] + "/where", Trigger, lambda request: TriggerResponse(True, socket.gethostname()))
rospy.spin()
