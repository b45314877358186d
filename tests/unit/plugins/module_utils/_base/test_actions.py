# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The option `action`: the former name and the former words ask for the same as those of today."""

import pytest
from ansible.module_utils.common.arg_spec import ArgumentSpecValidator
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import actions
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import multicast
from ansible_collections.rosfleet.multimaster.plugins.modules import multimaster_verify, multimaster_watch

OPTIONS = {
    "multicast_verify": multicast.OPTIONS["action"],
    "multimaster_verify": multimaster_verify.ARGUMENTS["action"],
    "multimaster_watch": multimaster_watch.ARGUMENTS["action"],
}
FORMER = {
    "multicast_verify": {"listed": "list", "started": "start", "collected": "collect"},
    "multimaster_verify": {"started": "start", "collected": "collect", "streamed": "stream", "stopped": "stop"},
    "multimaster_watch": {"started": "start", "collected": "collect", "stopped": "stop"},
}
CASES = [(module, former, action) for module, words in FORMER.items() for former, action in words.items()]


@pytest.mark.parametrize(("module", "former", "action"), CASES)
@pytest.mark.parametrize("name", ["action", "state"])
def test_a_former_word_asks_for_the_same(module, former, action, name):
    validator = ArgumentSpecValidator({"action": OPTIONS[module]})
    for word in (former, action):
        result = validator.validate({name: word})
        assert not result.error_messages and actions.read_action(result.validated_parameters) == action


@pytest.mark.parametrize("module", OPTIONS)
def test_other_words_are_refused(module):
    words = {*FORMER[module], *FORMER[module].values()}
    assert set(OPTIONS[module]["choices"]) == words
    assert ArgumentSpecValidator({"action": OPTIONS[module]}).validate({"action": "restart"}).error_messages
