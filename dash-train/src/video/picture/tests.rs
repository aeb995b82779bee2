use super::*;

fn stated(json: &serde_json::Value) -> Stated {
    let mut with_size = serde_json::json!({"width": 64, "height": 48});
    let object = with_size.as_object_mut().expect("an object");
    object.extend(json.as_object().expect("an object").clone());
    serde_json::from_value(with_size).expect("a listing")
}

fn picture(json: serde_json::Value) -> Result<Picture, Error> {
    Picture::new(Path::new("a.mp4"), &stated(&json))
}

fn matrix([a, b, c, d]: [i64; 4]) -> serde_json::Value {
    let lines = format!("\n00000000: {a} {b} 0\n00000001: {c} {d} 0\n00000002: 0 0 1073741824\n");
    serde_json::json!({"side_data_list": [{"side_data_type": "CPB"}, {"displaymatrix": lines}]})
}

#[test]
fn plain_pictures_are_only_converted() {
    let tagged = serde_json::json!({
        "sample_aspect_ratio": "1:1", "color_range": "tv", "color_space": "bt709", "color_transfer": "bt709",
        "color_primaries": "bt709", "side_data_list": []
    });
    for listing in [
        serde_json::json!({}),
        tagged,
        matrix([65536, 0, 0, 65536]),
        matrix([0; 4]),
    ] {
        let picture = picture(listing.clone()).expect("plain");
        let own = format!("scale=64:48:{LARGER}");
        assert_eq!(picture.filters(false, None), [own], "{listing}");
        assert!(picture.remarks.is_empty(), "{listing}");
    }
}

#[test]
fn turns_by_about_a_right_angle_are_turns() {
    for (entries, filters) in [
        ([0, 65536, -65536, 0], "transpose=clock"),
        ([100, 65536, -65536, 100], "transpose=clock"),
        ([0, -131072, 65536, 0], "transpose=cclock"),
        ([-65536, 0, 0, -65536], "hflip,vflip"),
    ] {
        let picture = picture(matrix(entries)).expect("a right angle");
        let turned = picture.filters(false, None);
        assert_eq!(turned[..turned.len() - 1].join(","), filters);
    }
    for entries in [
        [46341, 46341, -46341, 46341],
        [65536, 3000, -3000, 65536],
        [65536, 0, 0, 0],
    ] {
        let error = picture(matrix(entries)).expect_err("askew").to_string();
        assert!(
            error.contains("a.mp4") && error.contains("degrees"),
            "{error}"
        );
    }
    let cut = serde_json::json!({"side_data_list": [{"displaymatrix": "\n00000000: 1 0\n"}]});
    assert!(picture(cut).is_err());
}

#[test]
fn pictures_are_turned_then_scaled() {
    let mut listing = matrix([0, 65536, -65536, 0]);
    listing["sample_aspect_ratio"] = "2:1".into();
    let picture = picture(listing).expect("both");
    let own = format!("transpose=clock,scale=48:128:{LARGER}");
    assert_eq!(picture.filters(false, None).join(","), own);
    let smaller = format!("transpose=clock,scale=24:64:{SMALLER}");
    assert_eq!(picture.filters(false, Some([24, 64])).join(","), smaller);
    assert!(picture.remarks[0].contains("2:1"), "{:?}", picture.remarks);
    for shape in ["0:1", "N/A", "1:1", "199:200"] {
        let listing = serde_json::json!({"sample_aspect_ratio": shape});
        assert_eq!(
            super::tests::picture(listing).expect("square").square,
            None,
            "{shape}"
        );
    }
}

#[test]
fn copied_pictures_get_their_colours_back() {
    let listing = serde_json::json!({"color_range": "pc", "color_space": "bt709"});
    let picture = picture(listing).expect("plain");
    let own = format!("scale=64:48:{LARGER}");
    let stated = "setparams=range=pc:colorspace=bt709";
    assert_eq!(picture.filters(true, None), [stated, &own]);
    let unknown = serde_json::json!({"color_range": "unknown", "color_space": "reserved"});
    let unknown = super::tests::picture(unknown).expect("plain");
    assert_eq!(unknown.filters(true, None), [own]);
}

#[test]
fn interlaced_and_transparent_pictures_are_told() {
    for (key, value, is_told) in [
        ("field_order", "tt", true),
        ("field_order", "bt", true),
        ("field_order", "progressive", false),
        ("pix_fmt", "yuva420p", true),
        ("pix_fmt", "bgra", true),
        ("pix_fmt", "yuv420p", false),
        ("pix_fmt", "rgb24", false),
    ] {
        let remarks = picture(serde_json::json!({key: value}))
            .expect("read")
            .remarks;
        assert_eq!(
            remarks.iter().any(|told| told.contains(value)),
            is_told,
            "{value}"
        );
    }
}

#[test]
fn wide_primaries_are_told() {
    for primaries in ["bt2020", "smpte432"] {
        let listing = serde_json::json!({"color_primaries": primaries});
        let remarks = picture(listing).expect("kept").remarks;
        assert!(remarks[0].contains(primaries), "{remarks:?}");
    }
}
