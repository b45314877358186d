# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Secrets of many kinds as they stand in logs and values: (kind, text, what must not be left of it). All are made up."""

KEY = "b3BlbnNzaC1rZXktdjEAAAAABG5vbmUAAAAEbm9uZQAAAAAAAAABAAAAMwAAAAtzc2gtZW"
TIME = "2026-11-22T14:02:12+0000 master_sync[812]: "
DASHES = "-" * 5

PLANTED = (
    ("password of a variable", "ansible_password: Hunter2!x", "Hunter2!x"),
    ("become password as JSON", '{"ansible_become_pass": "s3cr et,x"}', "s3cr et,x"),
    ("password in words", "login with password Tr0ub4dor", "Tr0ub4dor"),
    ("private key", f"{DASHES}BEGIN OPENSSH PRIVATE KEY{DASHES}\n{KEY}\n{DASHES}END OPENSSH PRIVATE KEY{DASHES}", KEY),
    (
        "private key in a journal",
        f"{TIME}{DASHES}BEGIN RSA PRIVATE KEY{DASHES}\n{TIME}{KEY}\n{TIME}shortEnd9==\n{TIME}{DASHES}END RSA PRIVATE KEY{DASHES}",
        "shortEnd9",
    ),
    ("end of a private key", f"{TIME}tailOfKey7\n{TIME}{DASHES}END PRIVATE KEY{DASHES}\n{TIME}next", "tailOfKey7"),
    ("line of a key", f"{TIME}{KEY}", KEY),
    ("token of the environment", "ROBOT_API_TOKEN=9f8e7d6c5b", "9f8e7d6c5b"),
    ("user and password in a URL", "git clone https://anna:pa55w@git.example.org/x.git", "pa55w"),
    ("password with a slash in a URL", "amqp://bot:p/w0rd@broker:5672/", "p/w0rd"),
    ("token in a URL", "https://oauth2tok3n@git.example.org/x", "oauth2tok3n"),
    ("token in a query", "GET /v1?x=1&access_token=abc.def-1&y=2", "abc.def-1"),
    ("access key of Amazon", "found AKIAIOSFODNN7EXAMPLE here", "AKIAIOSFODNN7EXAMPLE"),
    ("secret key of Amazon", "aws_secret_access_key = wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLE", "wJalrXUtnFEMI"),
    ("bearer", "Authorization: Bearer abcdef.12345", "abcdef.12345"),
    ("basic authorization", "Proxy-Authorization: Basic dXNlcjpwYXNz", "dXNlcjpwYXNz"),
    ("JSON web token", "got eyJhbGciOiJIUzI1NiJ9.eyJzdWIiOiIxIn0.c2lnbmF0dXJl", "eyJzdWIiOiIxIn0"),
    ("wifi psk", 'network={ ssid="lab" psk="correct horse" }', "correct horse"),
    ("wifi of NetworkManager", "802-11-wireless-security.psk: batterystaple", "batterystaple"),
    ("API key of a ROS parameter", "/camera/api_key: 0123-4567", "0123-4567"),
    ("API key in camel case", "{'mapsApiKey': 'abc123'}", "abc123"),
    ("key of Google", "key AIzaSyA-1234567890abcdefghijklmnopqrstu used", "AIzaSyA"),
    ("token of GitHub", "remote ghp_0123456789abcdefghijABCDEFGHIJ012345", "ghp_0123456789"),
    ("token of GitLab", "glpat-ABCdef_1234567890xyz", "glpat-ABCdef"),
    ("token of Slack", "xoxb-123456789012-abcdefghijkl", "xoxb-123456789012"),
    (
        "text of ansible-vault",
        f"{TIME}$ANSIBLE_VAULT;1.1;AES256\n{TIME}62313365396662343061393464336163\n",
        "6231336539",
    ),
    ("hashed password", "root:$6$saltsalt$abcdefghijklmnop/qrstuv:19000:", "abcdefghijklmnop"),
    ("cookie", "Set-Cookie: session=deadbeef; Path=/", "deadbeef"),
    ("private key of WireGuard", "PrivateKey = yAnz5TF+lXXJte14tji3zlMNq+hd2rYUIgJBgB3fBmk=", "yAnz5TF"),
    ("option of a command", "run --db-password opensesame --verbose", "opensesame"),
    ("sshpass", "sshpass -p letmein ssh robot", "letmein"),
    ("user of curl", "curl -s -u anna:qwerty http://x", "qwerty"),
)
