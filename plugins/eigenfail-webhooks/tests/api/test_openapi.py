"""The OpenAPI document with the extension: held to what the core's document is held to."""

from plugin_documents import borrow_checks, check_additions

# pytest collects them here, with the service of the plug-in.
globals().update(borrow_checks())

PATHS = {
    "/api/v1/webhooks",
    "/api/v1/webhooks/{webhook}",
    "/api/v1/webhooks/{webhook}/test",
}


def test_the_routes_and_their_answers_are_in_it(document, plugin):
    readme = (plugin / "README.md").read_text()
    for path in PATHS:
        for operation in document["paths"][path].values():
            assert operation["description"] in readme
    made = document["paths"]["/api/v1/webhooks"]["post"]["responses"]["201"]["content"]
    assert made["application/json"]["schema"] == {"$ref": "#/components/schemas/NewWebhook"}


def test_all_else_is_the_document_of_the_core(document):
    check_additions(document, PATHS)
