//! The committed JSON Schema is the one that the types give.

#[test]
fn the_schema_is_fresh() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../api/scene.schema.json");
    let fresh = scene::native::schema();
    if std::env::var_os("BROLLY_BLESS").is_some() {
        std::fs::write(&path, &fresh).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        committed == fresh,
        "api/scene.schema.json is stale: run the tests with BROLLY_BLESS=1"
    );
}
