# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
from ._LinkState import *
from ._LinkStatesStamped import *
from ._MasterState import *
from ._ROSMaster import *
from ._SyncMasterInfo import *
from ._SyncServiceInfo import *
from ._SyncTopicInfo import *
