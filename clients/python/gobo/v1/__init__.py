# SPDX-License-Identifier: Apache-2.0
"""Messages and stubs of the protocol, generated from proto/gobo/v1/*.proto by the build (target python_client)."""
