"""The OpenAPI document with the extension: held to what the core's document is held to."""

from plugin_documents import borrow_checks, check_additions

# pytest collects them here, with the service of the plug-in.
globals().update(borrow_checks())


def test_the_route_and_its_answer_are_in_it(document, plugin):
    operation = document["paths"]["/api/v1/region"]["get"]
    content = operation["responses"]["200"]["content"]
    assert content["application/json"]["schema"]["$ref"].endswith("/Region")
    assert operation["description"] in (plugin / "README.md").read_text()


def test_all_else_is_the_document_of_the_core(document):
    check_additions(document, {"/api/v1/region"})
